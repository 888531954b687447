"""What a planner observes and what it answers; how it is made, and its answers checked.

All lengths are in one unit of the caller's choice, m in palpate itself. Planners compute with
fractions of the object's height, so that a plan in millimetres is the plan in metres. A planner may
be a user's own: an answer that cannot be carried out is refused.
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

MIN_AZIMUTHS = 4  # of a usable slice
MIN_FEATURE = 1e-4  # [height] finer than any pad touches, and too many spans to count
MAX_ROUNDING = 1e-9  # [height] heights that differ by less are one
ALL_REACHED = "every limit is kept"  # reason of a planner that stops with success
# The first is the default.
PLANNER_NAMES = ("predicted", "touches", "uniform", "thesis", "fuzzy", "learned")


@dataclass(frozen=True, slots=True, kw_only=True)
class SliceSettings:
    """How near slices may come to each other and to the object's ends.

    What lies between a slice and an edge is unknown, and a slice near a pole is small. So the first
    and the last slice lie a fraction of the height inside the ends; nearer to them where the
    tolerance is small.
    """

    min_spacing: float = 0.03  # [height] of two slices; nearer ones show hardly more than one
    end_fraction: float = 0.03  # [height] of the first and the last slice from the ends, at most
    min_end_fraction: float = 0.02  # [height] the same, at least
    end_tolerances: float = 20.0  # [tolerances] the same distance, between these two limits
    end_deviations: float = 2.0  # [standard deviations of an end] the same, at least


class SliceOutcome(StrEnum):
    """How a slice ended."""

    CLOSED = "closed"  # all around
    OCCLUDED = "occluded"  # with gaps that the pad cannot reach; they are interpolated
    FAILED = "failed"  # touched, but of no use
    CUT = "cut"  # left unfinished, as a limit was reached
    LOST = "lost"  # nothing was touched: the height lies beyond the object's end


@readable
@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ObservedSlice:
    """One slice that was requested; without radii if it gave no usable contour.

    Its profile is given at k even azimuths; k is 0 without a contour.
    """

    height: float  # [m]
    outcome: SliceOutcome
    radii: Floats  # (k,) [m] distances from the axis
    slopes: Floats  # (k,) of the radius over the height, from the normals
    curvatures: Floats  # (k,) [1/m] of the side along z, positive where it bulges
    contact_low: Floats  # (k,) [m] lowest height that was touched
    contact_high: Floats  # (k,) [m] highest height that was touched
    deviation: float = 0.0  # [m] standard deviation of the model at this height
    touches: int = 0  # that it took
    seconds: float = 0.0  # [s] robot time that it took

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise ValueError(f"height must be finite, got {self.height} m")
        for name, unit in (("deviation", "m"), ("touches", "touches"), ("seconds", "s")):
            not_negative(name, getattr(self, name), unit)
        count = len(finite_array("radii", self.radii, (None,)))
        for name in ("slopes", "curvatures", "contact_low", "contact_high"):
            finite_array(name, getattr(self, name), (count,))
        if self.usable and (count < MIN_AZIMUTHS or not self.radii.min() > 0.0):
            raise ValueError(
                f"radii must be at least {MIN_AZIMUTHS} positive lengths where the outcome is "
                f"{self.outcome}, got {count}"
            )

    @property
    def usable(self) -> bool:
        """Whether it shows where the surface is."""
        return self.outcome in (SliceOutcome.CLOSED, SliceOutcome.OCCLUDED)


def slice_without_contour(
    height: float, outcome: SliceOutcome, touches: int = 0, seconds: float = 0.0
) -> ObservedSlice:
    """A slice that was requested and of which only the outcome is known."""
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

    most_touches: float = math.inf  # that may be made
    most_seconds: float = math.inf  # [s] robot time that may pass
    touches: int = 0  # made
    seconds: float = 0.0  # [s] robot time that has passed
    cut: bool = False  # whether not even one more touch fits into what is left

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

    low: float  # [m] height of the object's lower end
    high: float  # [m] height of its upper end
    low_deviation: float = 0.0  # [m] standard deviation of the lower end
    high_deviation: float = 0.0  # [m] standard deviation of the upper end
    tolerance: float  # [m] root mean square error that is asked for
    resolution: float  # [m] smallest difference that the sensor resolves
    feature: float  # [m] largest height that may stay untouched
    # Share of the surface that may be an untouched underside; None: an underside counts as flat.
    underside_share: float | None = None
    budget: Budget = field(default_factory=Budget)
    slices: tuple[ObservedSlice, ...] = ()  # in the order in which they were requested
    busy_heights: tuple[float, ...] = ()  # [m] at which other fingers are at work
    finger_spacing: float = 0.0  # [m] height that two fingers keep between them
    all_taxels: bool = False  # the solid is rebuilt from all taxels, not from contours alone
    # [m] standard deviation of the whole surface of that solid, ends included; None without one.
    deviation: float | None = None
    ends_deviation: float = 0.0  # [m] the part of it that the ends make
    pose_deviation: float = 0.0  # [m] standard deviation of a touch's place; 0 if none is seen
    bounded: bool = True  # the method of rebuilding states errors
    surface: ObservedSurface | None = None  # the solid, for single touches; None without one
    general: bool = False  # `surface` is a general solid, by which touches are planned, not slices
    tried: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # [m] recent targets of touches
    resting: Floats | None = None  # (3,) [m] place of the finger that asks, world frame
    slicing: SliceSettings = field(default=SliceSettings(), repr=False)

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ValueError(f"high must lie above low {self.low} m, got {self.high} m")
        for name in ("tolerance", "resolution", "feature"):
            positive(name, getattr(self, name), "m")
        if self.feature < MIN_FEATURE * self.extent:
            raise ValueError(
                f"feature must be at least {MIN_FEATURE:g} of the height {self.extent:g} m, "
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
        counts = {len(usable.radii) for usable in self.usable_slices}
        if len(counts) > 1:
            raise ValueError(f"all slices must have equally many azimuths, got {sorted(counts)}")

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
        """Those that show where the surface is, in the order in which they were requested."""
        return tuple(observed for observed in self.slices if observed.usable)

    @property
    def extent(self) -> float:
        """Height of the object [m]."""
        return self.high - self.low

    @property
    def spacing(self) -> float:
        """Smallest distance of two slices [m]."""
        return min(self.feature, self.slicing.min_spacing * self.extent)

    @property
    def end_uncertainty(self) -> float:
        """Height that may be missing at the less certain end [m]."""
        return self.slicing.end_deviations * max(self.low_deviation, self.high_deviation)


class Height(NamedTuple):
    """Trace this slice next."""

    height: float  # [m]
    reason: str  # in words


class Touch(NamedTuple):
    """Make this single touch next."""

    pose: Pose  # from which the pad moves along its z axis, world frame
    reach: float  # [m] longest distance that it moves
    target: Floats  # (3,) [m] where the surface is expected
    reason: str  # in words


class Wait(NamedTuple):
    """Nothing to do until another finger has finished."""

    reason: str  # in words


class Stop(NamedTuple):
    """Trace no more."""

    reason: str  # in words


class Planner(Protocol):
    """A rule, with its numbers. It remembers nothing: the same `Observation`, the same answer.

    A planner may have a second method, `settled`: it answers with a `Height` that depends on no
    model, or None; that slice is begun while a model is being made. A planner that chooses single
    touches has an attribute ``single_touches`` that is true: its solid has any shape.
    """

    def next(self, observation: Observation) -> Choice:
        """The next slice, or that there is none."""
        ...


def first_and_last(observation: Observation) -> tuple[float, float]:
    """Heights of the lowest and the highest slice [m]."""
    extent, settings = observation.extent, observation.slicing
    wanted = max(
        settings.end_tolerances * observation.tolerance, settings.min_end_fraction * extent
    )
    inside = min(wanted, settings.end_fraction * extent)
    low = observation.low + max(inside, settings.end_deviations * observation.low_deviation)
    high = observation.high - max(inside, settings.end_deviations * observation.high_deviation)
    middle = 0.5 * (observation.low + observation.high)
    return min(low, middle), max(high, middle)


def exhausted_budget(observation: Observation) -> str | None:
    """Which budget is spent, in words; None if something is left of it.

    If less is left than a whole slice takes, a part of the slice is traced.
    """
    budget = observation.budget
    if not budget.spent:
        return None
    parts = [
        f"{used:.4g} of {limit:g} {what}"
        for what, used, limit in (
            ("touches", budget.touches, budget.most_touches),
            ("s of robot time", budget.seconds, budget.most_seconds),
        )
        if limit < math.inf
    ]
    return f"the budget is spent: {' and '.join(parts)}"


def was_asked(observation: Observation, height: float) -> bool:
    """Whether a slice was requested at a height [m], whatever its outcome."""
    heights = (*(made.height for made in observation.slices), *observation.busy_heights)
    return any(abs(height - other) <= MAX_ROUNDING * observation.extent for other in heights)


def is_near_finger(observation: Observation, height: float) -> bool:
    """Whether another finger is too near to a height [m]."""
    return any(abs(height - busy) < observation.finger_spacing for busy in observation.busy_heights)


class WrongChoiceError(ValueError):
    """A planner's answer that cannot be carried out."""


def check_choice(planner: Planner, observation: Observation) -> Choice:
    """A planner's answer, checked.

    Raises WrongChoiceError if it is no answer; or a height that does not lie between the ends, was
    requested before, or is too near to another finger; or a touch that begins inside the object or
    out of reach; or a wait though no finger is at work.
    """
    choice = planner.next(observation)
    wrong = _wrong(observation, choice)
    if wrong:
        name = type(planner).__name__
        raise WrongChoiceError(f"the planner {name} gave an invalid answer: {wrong}")
    return choice


def settled_height(planner: Planner, observation: Observation) -> Height | None:
    """A slice that depends on no model, if the planner has one and budget is left; or None."""
    if exhausted_budget(observation) is not None:
        return None
    settled: Callable[[Observation], object] = getattr(planner, "settled", lambda _: None)
    choice = settled(observation)
    if isinstance(choice, Height) and not _wrong_height(observation, choice.height):
        return choice
    return None


def _wrong(observation: Observation, choice: object) -> str:
    """What is wrong with an answer; empty if it is valid."""
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
    """What is wrong with a touch; empty if it is valid."""
    surface = observation.surface
    if not _is_pose(choice.pose) or not 0.0 < choice.reach < math.inf:
        return f"a touch must have a finite Pose and a reach, got {choice!r:.60}"
    place = choice.pose.position
    if surface is None:
        return "a touch needs a known solid, and there is none"
    if float(np.hypot(*place[:2])) > surface.reach:
        return f"a touch must begin within {surface.reach:g} m of the axis, got {_text_of(place)}"
    if surface.platform is not None and place[2] < surface.platform - surface.reach:
        low = f"{surface.reach:g} m below the platform"
        return f"a touch must begin no lower than {low}, got {place[2]:g} m"
    if surface.is_inside(place):
        return f"a touch must begin outside the object, got {_text_of(place)}"
    return ""


def _is_pose(pose: object) -> bool:
    return isinstance(pose, Pose) and all(np.isfinite(part).all() for part in pose)


def _text_of(place: Floats) -> str:
    return "(" + ", ".join(f"{part:.3g}" for part in place) + ") m"


def _wrong_height(observation: Observation, height: float) -> str:
    """What is wrong with a height; empty if it is valid."""
    if not observation.low < height < observation.high:  # which nan is not, either
        ends = f"{observation.low:g} and {observation.high:g} m"
        return f"a height must lie between {ends}, got {height:g} m"
    if was_asked(observation, height):
        return f"a slice at {height:g} m was requested before; it must go elsewhere, or stop"
    limit = observation.finger_spacing
    for busy in observation.busy_heights:
        if abs(height - busy) < limit * (1.0 - MAX_ROUNDING):
            return f"{height:g} m is nearer than {limit:g} m to a finger at {busy:g} m"
    return ""


def planner_type(name: str) -> type[Planner]:
    """The class of a planner: by its name, or a user's own as ``module:Class``.

    Raises LookupError if there is none; ValueError if the module cannot be imported, or holds none.
    """
    planner = class_by_name(name, what="planner", names=PLANNER_NAMES, package=str(__package__))
    wanted = name.rpartition(":")[2]
    is_frozen = is_dataclass(planner) and getattr(planner, "__dataclass_params__").frozen  # noqa: B009
    has_next = callable(getattr(planner, "next", None))
    if not isinstance(planner, type) or not is_frozen or not has_next:
        raise ValueError(
            f"{name!r} is no planner: {wanted!r} must be a frozen dataclass with next(observation)"
        )
    return cast("type[Planner]", planner)


def make_planner(name: str, settings: Mapping[str, Any]) -> Planner:
    """A planner with its settings, which are its fields, except for records of tuned numbers.

    Raises errors as `planner_type`, and ValueError if a number is unknown or out of its range.
    """
    planner = planner_type(name)
    declared = getattr(planner, "__dataclass_fields__").items()  # noqa: B009
    fields = {name for name, field in declared if not is_dataclass(field.default)}
    unknown = sorted(set(settings) - fields)
    if unknown:
        raise ValueError(
            f"the planner {name!r} has no {', '.join(unknown)}; it has {', '.join(sorted(fields))}"
        )
    try:
        return planner(**settings)
    except TypeError as error:  # a required one is missing, say
        raise ValueError(f"the planner {name!r} cannot be made: {error}") from None
    except ValueError:
        raise
    except Exception as error:  # a user's class may fail in any way
        raise ValueError(f"the planner {name!r} cannot be made: {describe_error(error)}") from error


Choice = Height | Touch | Wait | Stop
