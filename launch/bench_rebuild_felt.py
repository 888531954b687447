"""Rebuilding from every touched taxel, measured against the contours of the same exploration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from palpate.core.arrays import Floats
from palpate.core.measure.distance import Prepared, compare, prepare
from palpate.core.rebuild.felt.felt_points import FeltPoints, felt_points, stack_points
from palpate.core.rebuild.reconstruct import reconstruct
from palpate.core.touch.jet import Jet
from palpate.launch.bench_row import Row
from palpate.launch.launch_file import describe
from palpate.launch.launch_path import EXPLORE
from palpate.launch.located import Located
from palpate.launch.override import override
from palpate.launch.run_dir import choose_run_dir
from palpate.launch.scene import find_scene
from palpate.messages.types import LogRecord, NodeStatus
from palpate.nodes.composed import run_composed
from palpate.nodes.reconstructor_set import frame_of, touched_ends
from palpate.nodes.sensor import pad_of_info

SMOOTH = ("sphere", "egg", "dented", "twisted", "vase")
SHARP = ("box", "gem", "notched")
COUNTS = (5, 9)
NOISE = {
    "pose_error": {"sigma": 1e-4, "rotation": 0.05},
    "gaussian_noise": {"sigma": 10e-6},
    "dead_taxels": {"rate": 0.01},
}
"""That of a sensor whose pose is known to 0.1 mm."""
TOLERANCE = 1.5e-4
"""Of the meshes that are compared, over the height."""
EXACT, NOISY_SMOOTH, NOISY = 0.5, 0.5, 0.8
"""Most error that may be left of the contours' own: without noise, and with it."""
HEARD = (
    *("/touch/info", "/touch/patch", "/contour/traced", "/probe/traced"),
    *("/world", "/plan/done", "/truth"),
)


class Felt(NamedTuple):
    """An exploration."""

    contours: list[Floats]
    """Points (n, 3) each, m."""
    points: FeltPoints
    """All touched taxels."""
    frame: Floats
    """Pose of the slicing frame, (7,)."""
    tops: Floats | None
    """Touches of the ends, (k, 3), m."""
    truth: Prepared
    """The object."""
    height: float
    """Of it, m."""
    floor: float
    """Chamfer distance between two tessellations of it, m."""


class Ears:
    """Keeps what it hears."""

    def __init__(self) -> None:
        self.said: dict[str, list[Any]] = {topic: [] for topic in HEARD}
        """Messages by topic."""

    def ready(self, seconds: float) -> None:
        """Nothing waits for it."""

    def heard(self, topic: str, message: object) -> None:
        """Keep a message."""
        self.said[topic].append(message)

    def log(self, record: LogRecord) -> None:
        """Nobody reads along."""

    def tick(self, statuses: Mapping[str, NodeStatus]) -> None:
        """Nobody looks on."""


def felt_rows(quick: bool) -> Iterable[Row]:
    """Errors of solids from all taxels over those of their contours alone.

    Parameters
    ----------
    quick : bool
        Fewer objects.
    """
    scenes = ("sphere", "box") if quick else (*SMOOTH, *SHARP)
    for noisy in (False, True):
        for count in COUNTS:
            for scene in scenes:
                most = EXACT if not noisy else NOISY_SMOOTH if scene in SMOOTH else NOISY
                yield _row(scene, explored(scene, count, noisy), count, noisy, most)


def explored(scene: str, count: int, noisy: bool) -> Felt:
    """Feel a shipped scene along so many contours, in this process."""
    args = {"scene": Located(str(find_scene(scene)), "scene"), "record": Located(False, "record")}
    settings = {
        "planner.planner": Located("uniform", "planner"),
        "planner.settings": Located({"count": count}, "count"),
    }
    if noisy:
        settings["simulator.effects"] = Located(NOISE, "effects")
    folder = choose_run_dir("bench", None)  # chosen, never made
    graph = override(describe(EXPLORE, args, folder.path).graph, settings)
    wirings = [one for one in graph.wirings() if one.name != "evaluator"]
    ears = Ears()
    run_composed(wirings, ends="planner", hear=HEARD, watcher=ears)
    return _felt(ears.said)


def _felt(said: Mapping[str, list[Any]]) -> Felt:
    [done], [truth], [world] = said["/plan/done"], said["/truth"], said["/world"]
    pad = pad_of_info(said["/touch/info"][-1])
    parts: dict[int, list[FeltPoints]] = {}
    for patch in said["/touch/patch"]:
        if patch.goal in (*done.contours, *done.probes):
            jet = Jet(patch.jet, patch.jet_scale) if len(patch.jet) else None
            points = felt_points(pad, patch.pose, patch.height, patch.mask, jet)
            parts.setdefault(patch.goal, []).append(points)
    contours = [one for one in said["/contour/traced"] if one.id in done.contours]
    probes = [one for one in said["/probe/traced"] if one.id in done.probes]
    prepared = prepare(truth.vertices, truth.faces)
    floor = compare(prepared, prepare(truth.floor_vertices, truth.floor_faces)).chamfer
    return Felt(
        contours=[one.points for one in contours],
        points=stack_points([one for each in parts.values() for one in each]),
        frame=frame_of(contours),
        tops=touched_ends(contours, probes, parts, world.platform),
        truth=prepared,
        height=truth.height,
        floor=floor,
    )


def _row(scene: str, felt: Felt, count: int, noisy: bool, most: float) -> Row:
    both = [_error(felt, felt.points), _error(felt, None)]
    ratio = both[0] / both[1]
    share = 100.0 / felt.height
    name = f"{scene}, {count} contours{', noise' if noisy else ''}: all taxels over contours"
    value = f"{both[0] * share:.4f} {ratio:.2f} x"
    # What two tessellations of the truth differ by cannot be halved.
    holds = ratio <= most or both[0] <= 2.0 * felt.floor
    return Row(name, value, f"<= {most:g} x (% of height; floor {felt.floor * share:.4f})", holds)


def _error(felt: Felt, points: FeltPoints | None) -> float:
    """Chamfer distance from the object, m."""
    solid = reconstruct(
        felt.contours, patches=points, tops=felt.tops, frame=felt.frame, method="skin"
    )
    mesh = solid.mesh(TOLERANCE * felt.height)
    return compare(felt.truth, prepare(mesh.vertices, mesh.faces)).chamfer
