"""``palpate gallery``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from palpate.launch.printing import titled
from palpate.tools.cli.command_line import (
    JSON,
    completing,
    out_option,
    print_figures,
    progress_printer,
)


def _figure_names(_: click.Context, __: str) -> Iterable[str]:
    from palpate.tools.gallery.sheet import FIGURES

    return FIGURES


@click.command("gallery", short_help="Draw the figures of the thesis, and some of palpate.")
@click.argument(
    "figures", nargs=-1, metavar="[FIGURE]...", shell_complete=completing(_figure_names)
)
@out_option("Folder, whose files of the same names are replaced.", default="gallery")
@click.option("--list", "listed", is_flag=True, help="List the figures, and draw none.")
@JSON
def gallery_command(figures: tuple[str, ...], out: Path, listed: bool, as_json: bool) -> None:
    """Draw the figures of Fung's thesis (1999) anew, and some of palpate's own, as PNG files.

    FIGURE is a name, such as superquadrics, or a number of the thesis, such as 2.2. All are drawn
    if none is named, which takes a minute.
    """
    from palpate.tools.gallery.sheet import FIGURES, find_figures, write_gallery

    names = find_figures(figures)
    if listed:
        facts = {name: FIGURES[name].facts() for name in names}
        lines = [line for name in names for line in titled(name, *facts[name].values(), width=18)]
        print_figures(facts, "\n".join(lines), as_json=as_json)
        return
    files = [str(path) for path in write_gallery(names, out, progress_printer(True, "drawing {}"))]
    print_figures(files, "\n".join(f"{file}: written" for file in files), as_json=as_json)
