"""All that is measured of the bus, by group; each is imported when it is its turn."""

from __future__ import annotations

from collections.abc import Iterator

from palpate.launch.bench_row import Group, Row


def _losses(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_bus import losses

    return losses(quick)


def _hops(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_bus import hops

    return hops(quick)


def _reliability(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_reliability import reliability

    return iter(reliability(quick))


def _start(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_start import start_rows

    return start_rows(2 if quick else 7)


def _locked(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_curve import curve_rows

    return curve_rows(500 if quick else 2000)


def _looking(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_looking import TURNS, rows

    return iter(rows(2 if quick else TURNS))


def _damage(quick: bool) -> Iterator[Row]:
    from palpate.launch.bench_damage import damage

    return damage(quick)


GROUPS: dict[str, Group] = {
    "losses": _losses,
    "hops": _hops,
    "reliability": _reliability,
    "start": _start,
    "locked": _locked,
    "looking": _looking,
    "damage": _damage,
}
"""Groups of figures, by name."""
