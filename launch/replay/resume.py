"""Goes on with an exploration from its recording: what was felt is not felt again.

Every node is handed what it had heard until then, in the order in which it was sent, and says
what it had said, unheard. From there the graph goes on, and comes to the same solid.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import msgspec

from palpate.launch.bag.bag_file import find_bag
from palpate.launch.own_modules import look_here
from palpate.launch.replay.before import before_of
from palpate.launch.replay.chosen import OURS
from palpate.launch.replay.order import in_order_of_sending
from palpate.launch.run import Plan
from palpate.launch.run_dir import RECORDING, choose_run_dir
from palpate.launch.versions import versions_text
from palpate.messages.codec import schema_hash
from palpate.messages.recording.reader import Kept, Recording, open_recording
from palpate.messages.types import TYPES, Contour
from palpate.nodes.node import AnyNode, keeps
from palpate.nodes.recording import RECORDER, Recorded, recorded_wirings, with_description
from palpate.nodes.wiring import Wiring, load_node

CONTOUR = Contour.__name__


def plan_resume(
    bag: Path, contour: int | None, *, nodes: Sequence[str] = (), out: Path | None = None
) -> Plan:
    """Plan to go on with a recorded exploration.

    Parameters
    ----------
    bag : Path
        The recording, or the folder of its run.
    contour : int or None
        The last contour of which is known; None for all that was recorded.
    nodes : texts
        Names of nodes whose modules are not palpate's own, and may be imported.
    out : Path, optional
        The new run directory.

    Raises
    ------
    ValueError
        If the recording cannot be read, does not say how it was made, has fewer contours, or a
        node cannot be loaded.
    InputError
        If the folder cannot be used.
    """
    recording = open_recording(find_bag(bag))
    about = {key: text for key, text in recording.about.items() if key not in ("graph", "version")}
    if not recording.graph or "ends" not in about:
        raise ValueError(f"recording {recording.path} does not say which graph made it")
    name = about.get("scene_name", recording.path.stem)
    folder = choose_run_dir(name, out)
    wirings = _wirings(recording, nodes, folder.path / RECORDING)
    about["versions"] = versions_text()
    return Plan(
        name,
        with_description(wirings, about),
        about["ends"],
        about,
        folder,
        before=before_of(wirings, _until(recording, contour)),
    )


def _wirings(recording: Recording, nodes: Sequence[str], path: Path) -> list[Wiring]:
    wirings = []
    for one in recorded_wirings(recording.graph):
        node = _load(recording, one, nodes)
        wiring = one.wiring(node.params)
        if one.module == RECORDER:
            params = msgspec.structs.replace(wiring.params, path=str(path))
            wiring = replace(wiring, params=params)
        wirings.append(replace(wiring, longest=node.longest, keeps=keeps(node)))
    return wirings


def _load(recording: Recording, one: Recorded, nodes: Sequence[str]) -> AnyNode:
    if not one.module.startswith(OURS):
        if one.name not in nodes:
            raise ValueError(
                f"recording {recording.path} wants module {one.module!r} for {one.name}, which is "
                f"not palpate's own; name it if you trust it: --nodes {one.name}"
            )
        look_here(f"{one.module}:NODE")
    return load_node(one.module)


def _until(recording: Recording, contour: int | None) -> Iterable[Kept]:
    """All that was sent before a contour was known, that contour included."""
    left = contour
    for kept in in_order_of_sending(recording):
        cls = TYPES.get(kept.type)
        if cls is not None and schema_hash(cls) != kept.schema:
            raise ValueError(f"{kept.topic} was recorded with another version of {kept.type}")
        yield kept
        if left is not None and kept.type == CONTOUR:
            left -= 1
            if left == 0:
                return
    if left is not None:
        assert contour is not None
        raise ValueError(
            f"recording {recording.path} has {contour - left} contours, so none to go on from "
            f"after {contour}"
        )
