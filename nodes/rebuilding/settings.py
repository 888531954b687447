"""What is tuned where requested sets are rebuilt: one record, which the reconstructor carries."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from palpate.core.explore import PlacingSettings, SweepSettings
from palpate.nodes.rebuilding.soundness import SoundnessSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateSettings:
    """Which solid is published, and how finely it is meshed."""

    # Mean gain in squared error beyond which a general solid is chosen over slices, if it also
    # meets `max_error_ratio`; larger values favour slices [standard errors of the mean gain].
    confidence_sigmas: float = 1.64
    max_error_ratio: float = 0.5  # rms prediction error of a chosen general solid over slices
    coarse_tolerance: float = 5e-4  # of a first mesh, which sets the final one [fraction of size]
    max_parts: int = 4  # pieces along each edge of a general solid's cell; more are not visible
    # Depth inside the solid beyond which a place without contact is an opening [m]; larger values
    # report fewer openings.
    hollow_depth: float = 0.4e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class RefitSettings:
    """When general solids are fitted again, and how many sets decide between methods."""

    n_sets: int = 3  # number of last sets whose predicted touches decide between methods
    whole_ratio: float = 1.25  # of touches to those at the last complete fit, to fit all again
    anew_ratio: float = 3.0  # of touches to those at the last fit without an earlier solid, for it


@dataclass(frozen=True, slots=True, kw_only=True)
class OpeningSettings:
    """Distances from all contacts beyond which a place without contact indicates a hole."""

    spanned_distance: float = 1.5e-3  # between contacts; if larger, narrow holes are missed [m]
    hanging_distance: float = 4.0e-3  # beside contacts; if smaller, edges seem to be holes [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class LocatingSettings:
    """How placements are estimated and reported."""

    n_places: int = 12_000  # sampled points of the solid, to which contacts are registered
    max_touches: int = 96  # maximum number of touches used where no hand made contacts
    standing_height: float = 0.2e-3  # over the platform; a lower face is the underside [m]
    underside_point_area: float = 12.0e-6  # area of the underside per sampled point [m^2]
    n_compared_places: int = 2_000  # sampled points, to compare the solid with itself, turned
    # Error of a point where the surface bends, since the spline rounds edges off [cells/rad].
    rounding_error: float = 0.25
    max_lean: float = math.radians(10.0)  # from the requested pose; a larger one is reported [rad]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReconstructorSettings:
    """How sets are rebuilt: all that the node's functions hand on to each other."""

    candidates: CandidateSettings = CandidateSettings()
    refits: RefitSettings = RefitSettings()
    openings: OpeningSettings = OpeningSettings()
    locating: LocatingSettings = LocatingSettings()
    placing: PlacingSettings = field(default=PlacingSettings())
    sweeps: SweepSettings = field(default=SweepSettings())
    soundness: SoundnessSettings = field(default=SoundnessSettings())  # of final solids
    # A draft lies off touches where slices are missing, and is extrapolated beyond the outermost
    # contours while the ends are unknown. Both call for more slices, not for another kind of solid:
    # so all its touches may be off it, and before the final model it may also reach any distance.
    draft_soundness: SoundnessSettings = field(default=SoundnessSettings(max_contradicted=1.0))
    early_soundness: SoundnessSettings = field(
        default=SoundnessSettings(max_contradicted=1.0, max_overhang=math.inf)
    )


DEFAULT_RECONSTRUCTOR = ReconstructorSettings()
