"""Study the parts of palpate one by one: what each is worth, how exact it is and what it costs.

    python tests/studies                          all of them
    python tests/studies shapes                   superquadrics, splines and other models
    python tests/studies casts                    the error of a cast
    python tests/studies curvature                filters and estimators against noise and impulses
    python tests/studies deformation              the zig-zag of the thesis, by its way and ours
    python tests/studies contours                 solids from them, beside those of other ways
    python tests/studies lofts                    their 95 % band, disorder and outliers, steps
    python tests/studies tracing                  slices of known solids, and what no pad can touch
    python tests/studies grasp                    what a few contacts tell of an object's frame
    python tests/studies recognition              stored objects and others, in any pose, with noise
    python tests/studies planners                 contours that each planner needs
    python tests/studies tolerances               whether a tolerance decides; what to expect of it
    python tests/studies bus                      losses among stalls, late starts and deaths
    python tests/studies start                    seven nodes, beside seven interpreters
    python tests/studies tools                    a graph's rate while a tool listens to it
    python tests/studies templates                step templates of the thesis, by kind of object
    python tests/studies ablation                 explorations without one part, and rebuilt solids
    python tests/studies explore                  objects that lean, other axes, several fingers
    python tests/studies effects                  each effect: its cost, and the error of a contour
    python tests/studies hops                     what a message costs, beside bare sockets
    python tests/studies lock                     the lock of the message bus between machines
    python tests/studies thesis [--runs RUN...]   the thesis against today: its two examples, and
                                                  recordings, rebuilt its way and ours
    python tests/studies scaling                  error and cost as contours, points, control
                                                  points, taxels, fingers and nodes grow, with the
                                                  powers; the memory of a graph over 10,000 touches
    python tests/studies accuracy                 what accuracy costs, by every method on eighteen
                                                  objects: one file, one sheet (docs/benchmark.md)
    python tests/studies real --meshes DIR        the meshes of a folder explored with noise, five
                                                  seeds each: errors, bounds, coverage, pictures

The last two take hours, go on where they were ended, and are made only if they are named.
``palpate dev bench`` measures whole scenes and procedures. Exits with 1 if a demand is missed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

# ``module:function`` by name, within this folder.
STUDIES: Mapping[str, Mapping[str, str]] = {
    "shapes": {
        "recovery": "shapes:recovery_rows",
        "splines": "shapes:spline_rows",
        "curves": "shapes:curve_rows",
        "models": "shapes:model_rows",
    },
    "casts": {"casts": "casts:cast_rows"},
    "curvature": {"curvature": "curvature:curvature_rows"},
    "deformation": {"deformation": "deformation:deformation_rows"},
    "contours": {"peers": "contours:peer_rows"},
    "lofts": {"disorder": "lofts:disorder_rows", "band": "lofts:band_rows"},
    "tracing": {"tracing": "tracing:tracing_rows"},
    "grasp": {"grasp": "grasping:grasp_rows"},
    "recognition": {"recognition": "recognition:recognition_rows"},
    "tolerances": {"tolerances": "tolerances:tolerance_rows"},
    "bus": {"losses": "losses:loss_rows", "reliability": "losses:reliability_rows"},
    "start": {"start": "starts:start_rows"},
    "tools": {"introspection": "listening:introspection_rows"},
    "planners": {"planners": "planners:planner_rows"},
    "templates": {"templates": "planners:template_rows"},
    "explore": {
        "tilted": "explorations:tilted_rows",
        "directions": "explorations:direction_rows",
        "fingers": "explorations:finger_rows",
    },
    "effects": {"effects": "effects:effect_rows"},
    "hops": {"hops": "hops:hop_rows"},
    "lock": {"lock": "locks:lock_rows"},
    "thesis": {"examples": "thesis:thesis_rows", "recorded": "thesis:recorded_rows"},
    "scaling": {"growth": "growth:growth_rows", "memory": "memory:memory_rows"},
    "ablation": {"parts": "ablation:part_rows", "taxels": "ablation:taxel_rows"},
    "accuracy": {"methods": "accuracy.measuring:accuracy_rows"},
    "real": {"meshes": "real:real_rows"},
}
NAMED = ("accuracy", "real")  # Studies that are made only if they are named
COSTS = ("touches", "robot", "compute")
# Which groups take which options.
TAKEN: Mapping[str, Sequence[str]] = {
    "thesis/recorded": ("runs",),
    "accuracy/methods": ("sheet", "cost", "meshes", "add", "method"),
    "real/meshes": ("sheet", "meshes"),
}


def main(argv: Sequence[str]) -> int:
    from palpate.bench.table import Group, named, run_groups
    from palpate.launch.files import InputError

    parser = argparse.ArgumentParser(
        prog="python tests/studies",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(STUDIES))
    parser.add_argument("--quick", action="store_true", help="fewer trials")
    parser.add_argument("--only", metavar="GROUP", help="one group of figures")
    parser.add_argument("--runs", nargs="+", type=Path, metavar="RUN", help="of the thesis: which")
    folder: dict[str, Any] = {"type": Path, "metavar": "DIR"}
    parser.add_argument("--sheet", **folder, help="runs and pictures go here; none is made again")
    parser.add_argument("--meshes", **folder, help="explore the meshes in here (too)")
    parser.add_argument("--cost", choices=COSTS, help="against which is drawn (touches)")
    parser.add_argument("--add", action="append", type=Path, help="runs of another method, as JSON")
    method = "measure this method, too"
    parser.add_argument("--method", action="append", metavar="MODULE:FUNCTION", help=method)
    told = parser.parse_args(argv)
    unknown = [name for name in told.names if name not in STUDIES]
    if unknown:
        parser.error(f"there is no study {unknown[0]!r}; there are {', '.join(STUDIES)}")
    groups: dict[str, str | Group] = {
        f"{name}/{group}": f"tests.studies.{place}"
        for name in told.names or [one for one in STUDIES if one not in NAMED]
        for group, place in STUDIES[name].items()
        if told.only in (None, group)
    }
    if told.runs:
        groups = {name: groups[name] for name in groups if name == "thesis/recorded"}
    given = {
        key: value for key in dict.fromkeys(chain(*TAKEN.values())) if (value := vars(told)[key])
    }
    for key in given:
        takers = [name for name, keys in TAKEN.items() if key in keys]
        if not any(name in groups for name in takers):
            parser.error(f"--{key} belongs to {' and '.join(takers)}")
    for name in groups.keys() & TAKEN.keys():
        if taken := {key: given[key] for key in TAKEN[name] if key in given}:
            groups[name] = partial(named(str(groups[name])), **taken)
    try:
        return run_groups(groups, quick=told.quick, strict=True)
    except InputError as error:
        parser.error(str(error))


if __name__ == "__main__":
    # Not this folder: its modules are named as the tests name them.
    sys.path[0] = str(Path(__file__).resolve().parents[2])
    sys.exit(main(sys.argv[1:]))
