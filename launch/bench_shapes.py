"""The mathematics of shapes and splines, measured: exactness, recoveries, and what they cost."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from palpate.launch.bench_row import Row
from palpate.launch.bench_shapes_curves import curve_rows
from palpate.launch.bench_shapes_models import model_rows
from palpate.launch.bench_shapes_recovery import recovery_rows
from palpate.launch.bench_shapes_splines import spline_rows

Echo = Callable[[str], None]

GROUPS: tuple[Callable[[bool], Iterable[Row]], ...] = (
    recovery_rows,
    spline_rows,
    curve_rows,
    model_rows,
)


def bench_shapes(*, quick: bool, echo: Echo = print) -> int:
    """Print the figures of shapes and splines, one a line, each as soon as it is known.

    Parameters
    ----------
    quick : bool
        Fewer shapes and points.
    echo : callable
        Takes one line.

    Returns
    -------
    int
        0 if every demand is met, else 1.
    """
    missed = False
    for group in GROUPS:
        for row in group(quick):
            missed = missed or not row.holds
            echo(str(row))
    return int(missed)
