"""The kinds of input: how each is damaged and read, which refusal is right, and what is valid."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from palpate.launch.located import InputError


class Kind(NamedTuple):
    """One kind of input."""

    name: str
    prepare: Callable[[Path], None]
    """Make what is needed, in a folder, and read what is sound, which must be accepted."""
    attempt: Callable[[random.Random, int, Path], None]
    """Read the damaged input of a number; raises what the reader does, or AssertionError
    if it accepts what is not valid."""
    refusal: type[Exception]
    """The error by which an input may be refused, or a child of it that is palpate's own."""


def _prepare_messages(_: Path) -> None:
    from palpate.launch.damage.messages import sound_packets
    from palpate.launch.damage.packets_read import read_packet

    for packet in sound_packets():
        read_packet(packet)


def _attempt_message(rng: random.Random, _: int, __: Path) -> None:
    from palpate.launch.damage.messages import damaged_packet
    from palpate.launch.damage.packets_read import read_packet

    read_packet(damaged_packet(rng))


def _prepare_recordings(folder: Path) -> None:
    from palpate.launch.damage.files_read import read_recording
    from palpate.launch.damage.recordings import NAME, recording_bombs, sound_recording

    recording_bombs()
    (folder / NAME).write_bytes(sound_recording())
    read_recording(folder / NAME)


def _attempt_recording(rng: random.Random, number: int, folder: Path) -> None:
    from palpate.launch.damage.files_read import read_recording
    from palpate.launch.damage.recordings import damaged_recording

    name, data = damaged_recording(rng, number)
    (folder / name).write_bytes(data)
    read_recording(folder / name)


def _prepare_meshes(folder: Path) -> None:
    from palpate.launch.damage.files_read import read_closed
    from palpate.launch.damage.mesh_bombs import mesh_bombs
    from palpate.launch.damage.mesh_samples import sound_meshes

    mesh_bombs()
    for name, data in sound_meshes().items():
        (folder / name).write_bytes(data)
        read_closed(folder / name)


def _attempt_mesh(rng: random.Random, number: int, folder: Path) -> None:
    from palpate.launch.damage.files_read import read_closed, read_open
    from palpate.launch.damage.meshes import damaged_mesh

    name, data = damaged_mesh(rng, number)
    (folder / name).write_bytes(data)
    read_open(folder / name)
    read_closed(folder / name)


def _prepare_scenes(folder: Path) -> None:
    from palpate.launch.damage.files_read import read_scene
    from palpate.launch.damage.scene_bombs import fill_folder, scene_bombs
    from palpate.launch.damage.scenes import NAME, sound_scenes

    scene_bombs()
    fill_folder(folder)
    for text in sound_scenes():
        (folder / NAME).write_bytes(text)
        read_scene(folder / NAME)


def _attempt_scene(rng: random.Random, number: int, folder: Path) -> None:
    from palpate.launch.damage.files_read import read_scene
    from palpate.launch.damage.scenes import damaged_scene

    name, data = damaged_scene(rng, number)
    (folder / name).write_bytes(data)
    read_scene(folder / name)


def _prepare_solids(folder: Path) -> None:
    from palpate.launch.damage.files_read import read_solid
    from palpate.launch.damage.solids import NAME, solid_bombs, sound_solid

    solid_bombs()
    (folder / NAME).write_bytes(sound_solid())
    read_solid(folder / NAME)


def _attempt_solid(rng: random.Random, number: int, folder: Path) -> None:
    from palpate.launch.damage.files_read import read_solid
    from palpate.launch.damage.solids import damaged_solid

    name, data = damaged_solid(rng, number)
    (folder / name).write_bytes(data)
    read_solid(folder / name)


KINDS: Mapping[str, Kind] = {
    "messages": Kind("messages", _prepare_messages, _attempt_message, ValueError),
    "recordings": Kind("recordings", _prepare_recordings, _attempt_recording, ValueError),
    "meshes": Kind("meshes", _prepare_meshes, _attempt_mesh, InputError),
    "scenes": Kind("scenes", _prepare_scenes, _attempt_scene, InputError),
    "solids": Kind("solids", _prepare_solids, _attempt_solid, InputError),
}
"""By name."""
