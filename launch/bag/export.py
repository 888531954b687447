"""A recording in the formats of others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from palpate.launch.bag.decoded import open_source
from palpate.launch.bag.export_csv import write_csv
from palpate.launch.bag.export_foxglove import write_foxglove
from palpate.launch.bag.export_npz import write_npz
from palpate.launch.bag.new_file import check_new, write_new

FORMATS = {
    "csv": (write_csv, "files"),
    "npz": (write_npz, "arrays"),
    "foxglove": (write_foxglove, "messages"),
}


def export_bag(bag: Path, kind: str, out: Path, topics: Sequence[str] = ()) -> str:
    """Write a recording in another format.

    Parameters
    ----------
    bag : Path
        A recording, or a run directory.
    kind : str
        ``"csv"``, ``"npz"`` or ``"foxglove"``.
    out : Path
        The new file, or for ``"csv"`` the new folder.
    topics : sequence of str
        The topics to write; all if empty.

    Returns
    -------
    str
        What was written, in a line.

    Raises
    ------
    InputError
        If the recording is damaged, has other message types than today's or no such topic, or
        there is something at `out` already.
    """
    check_new(out)
    source = open_source(bag, topics)
    write, what = FORMATS[kind]
    written: list[object] = []
    write_new(out, lambda part: written.append(write(source, part)))
    count = written[0] if isinstance(written[0], int) else len(written[0])  # type: ignore[arg-type]
    note = (
        "" if source.recording.closed else "; the recording was never closed, it may lack its end"
    )
    return f"{out}: {count} {what} of {len(source.topics)} topics{note}"
