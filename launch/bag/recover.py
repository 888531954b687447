"""Saves the longest whole beginning of a recording as a new one."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from palpate import __version__
from palpate.launch.bag.bag_file import find_bag
from palpate.launch.bag.new_file import check_new, write_new
from palpate.launch.located import InputError
from palpate.messages.recording.checked import End, Prefix
from palpate.messages.recording.copy import RecordingCopy
from palpate.messages.recording.parts import part_path, parts_of

NOTE = "recovered"
"""Name of the metadata record that says where a copy comes from."""


class Recovered(NamedTuple):
    """What was saved."""

    path: Path
    """The new recording."""
    parts: tuple[Path, ...]
    """The files that it was made of."""
    counts: dict[str, int]
    """Messages by topic."""
    end: End
    """Where the whole records end."""


def recover(bag: Path, out: Path | None = None) -> Recovered:
    """Write all that is whole of a recording, from its beginning on, into one new file.

    Parameters
    ----------
    bag : Path
        A recording, or a run directory.
    out : Path, optional
        The new file; ``NAME.recovered.mcap`` beside the recording if left out.

    Raises
    ------
    InputError
        If nothing can be saved, or the new file exists or cannot be written.
    """
    source = find_bag(bag)
    target = out or source.with_name(f"{source.stem}.{NOTE}{source.suffix}")
    check_new(target)
    further = part_path(target, 1)
    if further.exists():
        raise InputError(f"{further}: would be taken for a part of {target}; take it away")
    saved: list[Recovered] = []
    write_new(target, lambda part: saved.append(_copy(source, part)))
    return saved[0]._replace(path=target)


def recovered_text(saved: Recovered) -> str:
    """What was saved, and what was not, in a line for each."""
    part, byte, why = saved.end
    if not why:
        what = "all that there was"
    elif byte == part.stat().st_size:
        what = f"all that there is in {part.name}, which {why}"
    else:
        what = f"up to byte {byte} of {part.name}, which {why}"
    of = f", of {len(saved.parts)} files" if len(saved.parts) > 1 else ""
    return (
        f"{saved.path}: {sum(saved.counts.values())} messages on {len(saved.counts)} topics{of}; "
        f"that is {what}"
    )


def _copy(source: Path, target: Path) -> Recovered:
    prefix, parts = Prefix(source), parts_of(source)
    copy = RecordingCopy(target, f"palpate {__version__}")
    try:
        copy.take(prefix)
        part, byte, why = prefix.end
        if not copy.counts:
            raise InputError(
                f"{part}: nothing can be recovered: no message comes before {_it(why)}"
            )
        about = {"from": " ".join(one.name for one in parts), "to": f"{part.name}, byte {byte}"}
        copy.close(NOTE, about | {"why": why})
    finally:
        copy.give_up()
    copy.check()
    return Recovered(target, parts, dict(copy.counts), prefix.end)


def _it(why: str) -> str:
    return f"its end: it {why}" if why else "its end"
