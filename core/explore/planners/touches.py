"""Single touches alone: each removes the most squared error per robot time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.planners import protocol
from palpate.core.explore.planners.approaches import TouchOffer
from palpate.core.explore.planners.surface import ObservedSurface, Progress
from palpate.core.explore.planners.verdict import judge
from palpate.core.plugins import Range, check_ranges


@dataclass(frozen=True, slots=True, kw_only=True)
class ChoiceSettings:
    """Which touch is made next. The gain of a touch is the squared error of the places it meets."""

    min_gain: float = 1e-3  # fraction of the squared error that the tolerance allows in all
    touch_seconds: float = 1.5  # [s] of a touch without the travel to it
    travel_speed: float = 0.1  # [m/s]
    min_gain_share: float = 0.6  # fraction of the largest gain, below which a touch is postponed
    # [fraction of the surface] unknown but reachable, above which it is touched in any case: the
    # model of an untouched thin end grows horns.
    min_open: float = 0.002


@dataclass(frozen=True, slots=True, kw_only=True)
class SettlingSettings:
    """When touches no longer change what is known.

    Touches end if the bound and the unknown area stayed the same over a recent stretch of touches,
    or if over a longer stretch neither fell below its lowest value before that stretch.
    """

    min_touches: int = 24  # of the recent stretch, at least
    share: float = 0.25  # fraction of all touches in the recent stretch
    bound_change: float = 0.06  # fraction of the error bound; smaller changes count as none
    open_change: float = 0.004  # [fraction of the surface] unknown; smaller changes count as none
    long_touches: int = 96  # of the longer stretch, at least
    long_share: float = 0.5  # fraction of all touches in the longer stretch


@dataclass(frozen=True, slots=True, kw_only=True)
class PayingSettings:
    """When more touches are worth their time."""

    n_touches: int = 20  # next touches that are judged together
    min_gain: float = 0.02  # fraction of the error bound, or of the unknown area, that they remove
    touched_distance: float = 1e-3  # [m] from a touch; nearer places give the bound after a touch


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchPlannerSettings:
    """Which touch a planner makes next, and when it makes no more."""

    choice: ChoiceSettings = ChoiceSettings()
    settling: SettlingSettings = SettlingSettings()
    paying: PayingSettings = PayingSettings()


DEFAULT_TOUCH_PLANNER = TouchPlannerSettings()


@dataclass(frozen=True, slots=True, kw_only=True)
class Touches:
    """The planner of single touches."""

    single_touches: ClassVar[bool] = True
    # A touch must take this share of the squared error that is asked for, over the whole surface.
    least_gain: Annotated[float, Range(0.0, 1.0, "1")] = DEFAULT_TOUCH_PLANNER.choice.min_gain
    settings: TouchPlannerSettings = DEFAULT_TOUCH_PLANNER

    def __post_init__(self) -> None:
        check_ranges(self)

    def next(self, observation: protocol.Observation) -> protocol.Choice:
        """The next touch, or that the demand is met, or that no touch would bring it nearer."""
        over = protocol.exhausted_budget(observation)
        if over is not None:
            return protocol.Stop(over)
        surface = observation.surface
        if surface is None:
            return self._first(observation)
        choice = next_touch(observation, surface, self.least_gain, settings=self.settings)
        if isinstance(choice, protocol.Stop) and observation.busy_heights:
            return protocol.Wait("other fingers are at work")
        return choice

    def _first(self, observation: protocol.Observation) -> protocol.Choice:
        """A slice through the middle: without a solid no place to touch is known."""
        if observation.busy_heights:
            return protocol.Wait("other fingers are at work")
        if observation.slices:
            return protocol.Stop("there is no solid whose surface could be touched")
        return protocol.Height(0.5 * (observation.low + observation.high), "there is no solid yet")


def next_touch(
    observation: protocol.Observation,
    surface: ObservedSurface,
    least_gain: float,
    bound: float | None = None,
    settings: TouchPlannerSettings = DEFAULT_TOUCH_PLANNER,
) -> protocol.Touch | protocol.Stop:
    """The touch of a surface that removes the most squared error per robot time.

    `least_gain` is used in place of `min_gain` of the settings. If the error `bound` [m] (None: the
    surface's) is within the tolerance, only unknown places count.
    """
    choice, paying = settings.choice, settings.paying
    if has_settled(surface.progress, settings.settling):
        return protocol.Stop("further touches no longer lower the error")
    left = surface.left(observation.tried)
    if bound is None:
        bound = surface.rms_bound_95
    asked_below = observation.limits.underside_share is not None
    is_rough = bound > observation.tolerance
    if is_rough and not touches_pay(surface, left, underside=asked_below, settings=paying):
        return protocol.Stop(
            f"the next {paying.n_touches} touches would lower neither error nor unknown area by "
            f"{paying.min_gain:.0%}"
        )
    aims = _aims(observation, surface, left, least_gain, bound, choice.min_open)
    for worth, wanted, reason in aims:
        offer = _best(observation, surface, worth, wanted, choice)
        if offer is not None:
            return protocol.Touch(*offer[:3], reason)
    findings = replace(surface.findings, error_bound=bound)
    if judge(findings, observation.limits).reached:
        return protocol.Stop(protocol.ALL_REACHED)
    if bound <= observation.tolerance:
        return protocol.Stop("no finger reaches what is unknown")
    if not _is_touchable_error_large(observation, surface):
        return protocol.Stop("no finger reaches where the error may be large")
    return protocol.Stop("no further touch would lower the error enough")


def _aims(
    observation: protocol.Observation,
    surface: ObservedSurface,
    left: Floats,
    least_gain: float,
    bound: float,
    min_open: float,
) -> Iterator[tuple[Floats, float, str]]:
    """Aims by precedence: worth of each place (n,), the least sum of a touch, and the reason."""
    if bound > observation.tolerance and _is_touchable_error_large(observation, surface):
        wanted = least_gain * observation.tolerance**2 * len(left)
        yield left, wanted, "the expected error is largest there"
    can_be = left > 0.0
    if surface.reachable(observation.tried) > min_open:
        yield (surface.away & can_be).astype(float), 1.0, "nothing near to it was touched"
    if observation.limits.underside_share is not None and surface.pose is not None:
        flat = surface.places.flat & can_be
        yield flat.astype(float), 1.0, "it stood there, and nothing has touched it since"


def _is_touchable_error_large(observation: protocol.Observation, surface: ObservedSurface) -> bool:
    """Whether the error of touchable places is too large; errors out of reach do not count."""
    limit = surface.touchable_limit(observation.tried, observation.tolerance)
    return surface.touchable_bound(observation.tried) > limit


def touches_pay(
    surface: ObservedSurface,
    left: Floats,
    *,
    underside: bool,
    settings: PayingSettings = PayingSettings(),
) -> bool:
    """Whether the best next touches would lower the error bound or what is unknown.

    `left` (n,): squared errors [m2] at places that touches may still remove. A place that a touch
    meets is assumed to have afterwards the median bound of touched places. `underside`: whether the
    side on which the object stood at first counts as unknown until it is touched.
    """
    gains = [float(left[offer.places].sum()) for offer in surface.offers]
    best = np.argsort(gains)[::-1][: settings.n_touches]
    met = np.zeros(len(left), np.bool_)
    for number in best:
        met[surface.offers[number].places] = True
    met &= left > 0.0
    places = surface.places
    unknown = surface.away & ~places.flat | (places.flat if underside else False)
    counted, slope = ~places.flat, surface.settings.hidden.unknown_slope
    # A deep hole may hide more than everything else, and no touch beside it lowers that.
    opened = places.spanned | surface.pits
    bounds = surface.bounds_there
    bounds = np.where(opened, np.minimum(bounds, slope * places.distances), bounds)[counted]
    near = places.distances[counted] <= settings.touched_distance
    touched = float(np.median(bounds[near])) if near.any() else 0.0
    after = np.where(met[counted], np.minimum(bounds, touched), bounds)
    lower = float(np.square(after).mean()) < (1.0 - settings.min_gain) ** 2 * float(
        np.square(bounds).mean()
    )
    return lower or int((unknown & met).sum()) > settings.min_gain * int(unknown.sum())


def has_settled(
    progress: Sequence[Progress], settings: SettlingSettings = SettlingSettings()
) -> bool:
    """Whether the last touches lowered neither the error bound nor the unknown area."""
    before, recent = _split(progress, settings.min_touches, settings.share)
    if before and len(recent) > 1:
        bounds, opened = [step.bound for step in recent], [step.open for step in recent]
        alike = max(bounds) - min(bounds) <= settings.bound_change * max(bounds)
        if alike and max(opened) - min(opened) <= settings.open_change:
            return True
    before, recent = _split(progress, settings.long_touches, settings.long_share)
    if not before or not recent:
        return False
    lower = min(step.bound for step in recent) < (1.0 - settings.bound_change) * min(
        step.bound for step in before
    )
    return not lower and min(step.open for step in recent) >= (
        min(step.open for step in before) - settings.open_change
    )


def _split(
    progress: Sequence[Progress], least: int, share: float
) -> tuple[Sequence[Progress], Sequence[Progress]]:
    """Progress before and in the last touches: `least` of them, or a `share` of all if more."""
    last = progress[-1].touches if progress else 0
    since = last - max(least, share * last)
    first = sum(step.touches < since for step in progress)
    return progress[:first], progress[first:]


def _best(
    observation: protocol.Observation,
    surface: ObservedSurface,
    left: Floats,
    wanted: float,
    settings: ChoiceSettings,
) -> TouchOffer | None:
    """The offer with the largest sum of `left` (n,) over its places, per robot time."""
    gains = [float(left[offer.places].sum()) for offer in surface.offers]
    least = max(wanted, settings.min_gain_share * max(gains, default=0.0))
    best, most = None, 0.0
    for offer, gain in zip(surface.offers, gains, strict=True):
        if gain < least:
            continue
        distance = 0.0
        if observation.resting is not None:
            distance = float(np.linalg.norm(offer.pose.position - observation.resting))
        rate = gain / (settings.touch_seconds + distance / settings.travel_speed)
        if rate > most:
            best, most = offer, rate
    return best
