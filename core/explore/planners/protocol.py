"""What a planner is told and what it answers; how one is made, and its answers checked.

All lengths are in one unit of the caller's choice, m in palpate itself. Planners work in shares of
the object's height, so that a plan in millimetres is the plan in metres. A planner may be a user's
own: an answer that nobody could act on is refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, is_dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from palpate.core.arrays import Floats, finite_array, not_negative, positive
from palpate.core.explore.planners.verdict import Limits
from palpate.core.plugins import class_by_name, describe_error
from palpate.core.poses import Pose
from palpate.reprs import readable

if TYPE_CHECKING:
    from palpate.core.explore.planners.surface import ObservedSurface

LEAST_AZIMUTHS = 4
# Of the object's height: finer than any pad touches, and than what was touched could be counted.
LEAST_FEATURE = 1e-4
LEAST_SPACING = 0.03  # Of the height: slices that are nearer tell hardly more than one
# The first and the last slice lie this share of the height inside the ends, or, where little error
# is asked for, so many times the tolerance, but no less than the nearer share: what lies between a
# slice and an edge is unknown, and a slice near a pole is small.
END_SHARE, NEAR_END_SHARE, END_TOLERANCES = 0.03, 0.02, 20.0
END_DEVIATIONS = 2.0  # And at least so many standard deviations of where the end is
SAME = 1e-9  # Of the height: heights that differ by less are one
ALL_REACHED = "every limit is kept"  # Why a planner stops that has reached what was asked
PLANNER_NAMES = (
    "predicted",
    "touches",
    "uniform",
    "thesis",
    "fuzzy",
    "learned",
)  # The default first


class SliceOutcome(StrEnum):
    """How a slice ended."""

    CLOSED = "closed"  # All around
    # With gaps that the pad cannot reach; what was touched is given, gaps are interpolated.
    OCCLUDED = "occluded"
    FAILED = "failed"  # Touched, but of no use
    CUT = "cut"  # Left unfinished, as a limit was reached
    LOST = "lost"  # Nothing was there to touch: the height lies beyond the object's end


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ObservedSlice:
    """One slice that was asked for; without radii if it gave no usable contour."""

    height: float  # m
    outcome: SliceOutcome  # How it ended
    radii: Floats  # Distances from the axis at k even azimuths, m; (k,), or (0,)
    slopes: Floats  # Of the radius over the height, from the normals; (k,)
    curvatures: Floats  # Of the side along z, positive where it bulges, 1/m; (k,)
    contact_low: Floats  # Lowest height that its patches have touched, m; (k,)
    contact_high: Floats  # Highest height that its patches have touched, m; (k,)
    deviation: float = 0.0  # Standard deviation of the model at this height, m
    touches: int = 0  # That it took
    seconds: float = 0.0  # Robot time that it took, s

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise ValueError(f"height must be finite, got {self.height} m")
        for name, unit in (("deviation", "m"), ("touches", "touches"), ("seconds", "s")):
            not_negative(name, getattr(self, name), unit)
        count = len(finite_array("radii", self.radii, (None,)))
        for name in ("slopes", "curvatures", "contact_low", "contact_high"):
            finite_array(name, getattr(self, name), (count,))
        if self.usable and (count < LEAST_AZIMUTHS or not self.radii.min() > 0.0):
            raise ValueError(
                f"radii must be at least {LEAST_AZIMUTHS} positive lengths where the outcome is "
                f"{self.outcome}, got {count}"
            )

    @property
    def usable(self) -> bool:
        """Whether it tells where the surface is."""
        return self.outcome in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED)


def slice_without_contour(
    height: float, outcome: SliceOutcome, touches: int = 0, seconds: float = 0.0
) -> ObservedSlice:
    """A slice that was asked for and of which nothing is known but how it ended."""
    none = np.zeros(0)
    return ObservedSlice(
        height=height,
        outcome=outcome,
        radii=none,
        slopes=none,
        curvatures=none,
        contact_low=none,
        contact_high=none,
        touches=touches,
        seconds=seconds,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What may be spent and what is spent."""

    most_touches: float = math.inf  # Touches that may be made
    most_seconds: float = math.inf  # Robot time that may pass, s
    touches: int = 0  # Touches made
    seconds: float = 0.0  # Robot time that has passed, s
    cut: bool = False  # Whether not even one touch more fits into what is left

    def __post_init__(self) -> None:
        for name, unit in (("most_touches", "touches"), ("most_seconds", "s")):
            value = getattr(self, name)
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value} {unit}")
        not_negative("touches", self.touches, "touches")
        not_negative("seconds", self.seconds, "s")

    @property
    def spent(self) -> bool:
        """Whether nothing is left of it."""
        over = self.touches >= self.most_touches or self.seconds >= self.most_seconds
        return over or self.cut


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Observation:
    """All that the choice of the next slice may depend on."""

    low: float  # Height of the object's lower end, m
    high: float  # Height of its upper end, m
    low_deviation: float = 0.0  # Standard deviation of the lower end, m
    high_deviation: float = 0.0  # Standard deviation of the upper end, m
    tolerance: float  # Root mean square error that is asked for, m
    resolution: float  # Smallest difference that the sensor tells, m
    feature: float  # Largest height that may stay untouched, m
    # Share of the surface that may be an untouched underside; None: that counts as flat.
    underside_share: float | None = None
    budget: Budget = field(default_factory=Budget)  # What may be spent
    slices: tuple[ObservedSlice, ...] = ()  # In the order in which they were asked for
    busy_heights: tuple[float, ...] = ()  # Heights at which other fingers are at work, m
    finger_spacing: float = 0.0  # Height that two fingers keep between them, m
    # Whether the solid is rebuilt from all that was touched, and not from contours alone.
    all_taxels: bool = False
    # Standard deviation of the whole surface of that solid, ends included, m; None without one.
    deviation: float | None = None
    ends_deviation: float = 0.0  # Of it, the part that the ends make, m
    pose_deviation: float = 0.0  # Standard deviation of a touch's place, m; 0 if none is seen
    bounded: bool = True  # Whether the method of rebuilding states errors
    # The solid as it is known, for single touches; None while there is none.
    surface: ObservedSurface | None = None
    # Whether that is a general solid, which predicts touches better than slices do.
    general: bool = False
    tried: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # What was aimed at since, m
    resting: Floats | None = None  # Where the finger is that asks, (3,), world frame, m

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(f"high must lie above low {self.low} m, got {self.high} m")
        for name in ("tolerance", "resolution", "feature"):
            positive(name, getattr(self, name), "m")
        if self.feature < LEAST_FEATURE * self.extent:
            raise ValueError(
                f"feature must be at least {LEAST_FEATURE:g} of the height {self.extent:g} m, "
                f"got {self.feature} m"
            )
        finite_array("busy_heights", self.busy_heights, (None,))
        if self.tolerance < self.resolution:
            raise ValueError(
                f"tolerance must be at least the sensor's resolution {self.resolution} m, "
                f"got {self.tolerance} m"
            )
        deviations = ("low_deviation", "high_deviation", "ends_deviation", "pose_deviation")
        for name in (*deviations, "finger_spacing"):
            not_negative(name, getattr(self, name), "m")
        if self.deviation is not None:
            not_negative("deviation", self.deviation, "m")
        counts = {len(one.radii) for one in self.usable_slices}
        if len(counts) > 1:
            raise ValueError(f"all slices must have as many azimuths, got {sorted(counts)}")

    @property
    def limits(self) -> Limits:
        """What is asked of the solid."""
        return Limits(
            tolerance=self.tolerance,
            feature=self.feature,
            underside_share=self.underside_share,
        )

    @property
    def usable_slices(self) -> tuple[ObservedSlice, ...]:
        """Those that tell where the surface is, in the order in which they were asked for."""
        return tuple(one for one in self.slices if one.usable)

    @property
    def extent(self) -> float:
        """Height of the object, m."""
        return self.high - self.low

    @property
    def spacing(self) -> float:
        """Least distance of two slices, m."""
        return min(self.feature, LEAST_SPACING * self.extent)


class Height(NamedTuple):
    """Trace this slice next."""

    height: float  # m
    reason: str  # Why there, in words


class Touch(NamedTuple):
    """Make this single touch next."""

    pose: Pose  # From which the pad moves along its z axis, world frame
    reach: float  # Longest way, m
    target: Floats  # Where the surface is expected, (3,), m
    reason: str  # Why there, in words


class Wait(NamedTuple):
    """Nothing to do until another finger has finished."""

    reason: str  # Why, in words


class Stop(NamedTuple):
    """Trace no more."""

    reason: str  # Why, in words


class Planner(Protocol):
    """A rule, with its numbers. It remembers nothing: the same `Observation`, the same answer.

    One that has slices in which no model has a say may have a second method, `settled`, which
    answers with such a `Height` or None: it is begun while a model is in the making. One that
    chooses single touches says so by ``single_touches``, true: its solid has any shape.
    """

    def next(self, observation: Observation) -> Choice:
        """The next slice, or that there is none."""
        ...


def first_and_last(observation: Observation) -> tuple[float, float]:
    """Heights of the lowest and the highest slice, m."""
    wanted = max(END_TOLERANCES * observation.tolerance, NEAR_END_SHARE * observation.extent)
    inside = min(wanted, END_SHARE * observation.extent)
    low = observation.low + max(inside, END_DEVIATIONS * observation.low_deviation)
    high = observation.high - max(inside, END_DEVIATIONS * observation.high_deviation)
    middle = 0.5 * (observation.low + observation.high)
    return min(low, middle), max(high, middle)


def exhausted_budget(observation: Observation) -> str | None:
    """Which budget is spent, in words; None if something is left of it.

    What is left may be less than a whole slice takes: then the slice is traced as far as it lasts.
    """
    budget = observation.budget
    if not budget.spent:
        return None
    parts = [
        f"{used:.4g} of {most:g} {what}"
        for what, used, most in (
            ("touches", budget.touches, budget.most_touches),
            ("s of robot time", budget.seconds, budget.most_seconds),
        )
        if most < math.inf
    ]
    return f"the budget is spent: {' and '.join(parts)}"


def was_asked(observation: Observation, height: float) -> bool:
    """Whether a slice was asked for at this height, whatever came of it."""
    heights = (*(one.height for one in observation.slices), *observation.busy_heights)
    return any(abs(height - one) <= SAME * observation.extent for one in heights)


def is_near_finger(observation: Observation, height: float) -> bool:
    """Whether another finger is too near to this height."""
    return any(abs(height - busy) < observation.finger_spacing for busy in observation.busy_heights)


class WrongChoiceError(ValueError):
    """A planner's answer that nobody can act on."""


def check_choice(planner: Planner, observation: Observation) -> Choice:
    """What a planner answers.

    Raises WrongChoiceError if it is no answer; or a height that does not lie between the ends, was
    asked for before, or is too near to another finger; or a touch that begins inside the object or
    out of reach; or it waits though no finger is at work.
    """
    choice = planner.next(observation)
    wrong = _wrong(observation, choice)
    if wrong:
        name = type(planner).__name__
        raise WrongChoiceError(f"the planner {name} gave no answer to act on: {wrong}")
    return choice


def settled_height(planner: Planner, observation: Observation) -> Height | None:
    """A slice in which no model has a say, if the planner has one and budget is left; or None."""
    if exhausted_budget(observation) is not None:
        return None
    settled: Callable[[Observation], object] = getattr(planner, "settled", lambda _: None)
    choice = settled(observation)
    if isinstance(choice, Height) and not _wrong_height(observation, choice.height):
        return choice
    return None


def _wrong(observation: Observation, choice: object) -> str:
    """What is wrong with an answer; nothing if nothing is."""
    match choice:
        case Height():
            return _wrong_height(observation, choice.height)
        case Touch():
            return _wrong_touch(observation, choice)
        case Wait():
            return "" if observation.busy_heights else "it waits, but no finger is at work"
        case Stop():
            return ""
    return f"it must answer with a Height, a Touch, a Wait or a Stop, got {choice!r:.60}"


def _wrong_touch(observation: Observation, choice: Touch) -> str:
    surface = observation.surface
    if not _is_pose(choice.pose) or not 0.0 < choice.reach < math.inf:
        return f"a touch must have a finite Pose and a reach, got {choice!r:.60}"
    place = choice.pose.position
    if surface is None:
        return "a touch asks for a solid that is known, and there is none"
    if float(np.hypot(*place[:2])) > surface.reach:
        return f"a touch must begin within {surface.reach:g} m of the axis, got {_told(place)}"
    if surface.platform is not None and place[2] < surface.platform - surface.reach:
        low = f"{surface.reach:g} m below the platform"
        return f"a touch must begin no lower than {low}, got {place[2]:g} m"
    if surface.is_inside(place):
        return f"a touch must begin outside the object, got {_told(place)}"
    return ""


def _is_pose(pose: object) -> bool:
    return isinstance(pose, Pose) and all(np.isfinite(part).all() for part in pose)


def _told(place: Floats) -> str:
    return "(" + ", ".join(f"{one:.3g}" for one in place) + ") m"


def _wrong_height(observation: Observation, height: float) -> str:
    if not observation.low < height < observation.high:  # nor is it if it is no number
        ends = f"{observation.low:g} and {observation.high:g} m"
        return f"a height must lie between {ends}, got {height:g} m"
    if was_asked(observation, height):
        return f"a slice was asked for at {height:g} m before; it must go elsewhere, or stop"
    limit = observation.finger_spacing
    near = [one for one in observation.busy_heights if abs(height - one) < limit * (1.0 - SAME)]
    if near:
        return f"{height:g} m is nearer than {limit:g} m to a finger at {near[0]:g} m"
    return ""


def planner_type(name: str) -> type[Planner]:
    """The description of a planner: by its name, or a user's own as ``module:Class``.

    Raises LookupError if there is none; ValueError if the module cannot be imported, or holds none.
    """
    found = class_by_name(name, what="planner", names=PLANNER_NAMES, package=str(__package__))
    wanted = name.rpartition(":")[2]
    frozen = is_dataclass(found) and getattr(found, "__dataclass_params__").frozen  # noqa: B009
    if not isinstance(found, type) or not frozen or not callable(getattr(found, "next", None)):
        raise ValueError(
            f"{name!r} is no planner: {wanted!r} must be a frozen dataclass with next(observation)"
        )
    return cast("type[Planner]", found)


def make_planner(name: str, settings: Mapping[str, Any]) -> Planner:
    """A planner with its numbers.

    Raises errors as `planner_type`, and ValueError if a number is unknown or out of its range.
    """
    described = planner_type(name)
    fields = set(getattr(described, "__dataclass_fields__"))  # noqa: B009
    unknown = sorted(set(settings) - fields)
    if unknown:
        raise ValueError(
            f"the planner {name!r} has no {', '.join(unknown)}; it has {', '.join(sorted(fields))}"
        )
    try:
        return described(**settings)
    except TypeError as error:  # one that must be given is missing, say
        raise ValueError(f"the planner {name!r} cannot be made: {error}") from None
    except ValueError:
        raise
    except Exception as error:  # a class of one's own may break in any way
        raise ValueError(f"the planner {name!r} cannot be made: {describe_error(error)}") from error


Choice = Height | Touch | Wait | Stop
