"""What was asked of a solid and what was reached: one judgement for planner, run and report.

Every demand is one `Criterion` with a name, a figure and a limit. A planner stops when all limits
are kept; a run names those that are not, and its exit code depends on them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple

CriterionUnit = Literal["m", "1", "#"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What is asked of a solid; None where nothing is asked."""

    tolerance: float | None = None  # of the root mean square error [m]
    feature: float | None = None  # largest gap that may stay untouched between contours [m]
    # Share of the surface that may lie farther than `unknown_distance` from every touch. A little
    # always does, beside what an object stands on and in corners that hold a pad off.
    unknown_share: float = 0.01
    # Share of the surface that may be an underside which nothing touched; None: it counts as flat.
    underside_share: float | None = None

    @property
    def unknown_distance(self) -> float:
        """Distance from every touch beyond which a place is unknown [m]: half a feature."""
        return math.inf if self.feature is None else 0.5 * self.feature

    def stated(self) -> dict[str, float]:
        """What is asked, by name, as messages carry it."""
        return _stated(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """What is known of a solid; None where it is not known, or does not apply to it."""

    error_bound: float | None = None  # 95 % bound of the root mean square error [m]
    underside_share: float | None = None  # share of the surface that is an untouched underside
    crease_error: float | None = None  # [m] error bound of creases too narrow for a finger
    crease_share: float | None = None  # share of the surface in such creases
    unknown_share: float | None = None  # of the surface, underside apart, far from every touch
    untouched_gap: float | None = None  # largest height of the side that no contour touched [m]
    unentered_hole: float | None = None  # width of the widest hole that no finger entered [m]
    untraced_height: float | None = None  # where contours were tried and could not be traced [m]
    closed: bool | None = None  # whether every edge of the mesh has exactly two faces
    self_crossings: int | None = None  # pairs of triangles that cross
    genus: int | None = None  # holes that go through the solid
    true_error: float | None = None  # root mean square error [m]; only of a simulation
    true_genus: int | None = None  # only of a simulation

    def stated(self) -> dict[str, float]:
        """What is known, by name, as messages carry it."""
        return _stated(self)


def _stated(record: Limits | Findings) -> dict[str, float]:
    return {name: float(value) for name, value in asdict(record).items() if value is not None}


class Criterion(NamedTuple):
    """One figure of a solid and its limit."""

    name: str
    value: float | None  # None: not known, so that the limit is not kept
    limit: float
    unit: CriterionUnit  # of both: metres, a share, or a count
    is_exact: bool = False  # whether the figure must be the limit, not only below it

    @property
    def is_met(self) -> bool:
        """Whether the limit is kept."""
        if self.value is None:
            return False
        return self.value == self.limit if self.is_exact else self.value <= self.limit


class Verdict(NamedTuple):
    """All that was asked of a solid."""

    criteria: tuple[Criterion, ...]

    @property
    def reached(self) -> bool | None:
        """Whether every limit is kept; None where nothing was asked."""
        return all(criterion.is_met for criterion in self.criteria) if self.criteria else None

    @property
    def failed(self) -> tuple[Criterion, ...]:
        """The limits that are not kept."""
        return tuple(criterion for criterion in self.criteria if not criterion.is_met)


def judge(findings: Findings, limits: Limits) -> Verdict:
    """Compare what is known of a solid with what is asked of it.

    The error bound counts wherever a tolerance is asked for, known or not; every other figure
    where it is known.
    """
    return Verdict((*_errors(findings, limits), *_coverage(findings, limits), *_surface(findings)))


def _errors(findings: Findings, limits: Limits) -> Iterator[Criterion]:
    tolerance = limits.tolerance
    if tolerance is None:
        return
    yield Criterion("error bound", findings.error_bound, tolerance, "m")
    # A part that alone exceeds the tolerance of the whole is named, with the error it may have.
    error, share = findings.crease_error, findings.crease_share
    if error is not None and share and error * math.sqrt(share) > tolerance:
        yield Criterion("crease error", error, tolerance / math.sqrt(share), "m")
    if findings.true_error is not None:
        yield Criterion("rms error", findings.true_error, tolerance, "m")


def _coverage(findings: Findings, limits: Limits) -> Iterator[Criterion]:
    if limits.underside_share is not None and findings.underside_share is not None:
        yield Criterion("underside", findings.underside_share, limits.underside_share, "1")
    if limits.feature is not None:
        if findings.unknown_share is not None:
            yield Criterion("unknown share", findings.unknown_share, limits.unknown_share, "1")
        if findings.untouched_gap is not None:
            yield Criterion("untouched gap", findings.untouched_gap, limits.feature, "m")
    if limits.tolerance is not None and findings.unentered_hole is not None:
        yield Criterion("unentered hole", findings.unentered_hole, 0.0, "m")
    if findings.untraced_height is not None:
        yield Criterion("untraced height", findings.untraced_height, 0.0, "m")


def _surface(findings: Findings) -> Iterator[Criterion]:
    if findings.closed is not None:
        yield Criterion("open surface", float(not findings.closed), 0.0, "#")
    if findings.self_crossings is not None:
        yield Criterion("self-crossings", float(findings.self_crossings), 0.0, "#")
    if findings.genus is not None and findings.true_genus is not None:
        yield Criterion(
            "genus", float(findings.genus), float(findings.true_genus), "#", is_exact=True
        )
