"""What is tuned of a general solid, as one record: `GeneralSettings`.

Settings of a single algorithm stand beside it, in its own file. Here are those of the grids, of the
band and of the solid itself, which several files use, and the record that composes all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from palpate.core.rebuild.general.bends import DEFAULT_BENDS, BendSettings
from palpate.core.rebuild.general.edges import EdgeSettings
from palpate.core.rebuild.general.errors import ErrorSettings
from palpate.core.rebuild.general.fitting import FitSettings
from palpate.core.rebuild.general.orientation import OrientationSettings
from palpate.core.rebuild.general.placements import MotionSettings
from palpate.core.rebuild.general.topology import CoarseSettings
from palpate.core.rebuild.general.walls import WallSettings
from palpate.reprs import readable


@dataclass(frozen=True, slots=True, kw_only=True)
class GridSettings:
    """How large objects may be, and how fine their grids: so that a fit stays within 0.4 GB.

    The factor of a bottle's band of 11,000 cells takes 0.36 GB, that of a ball of 51,000 2.3 GB.
    """

    max_extent: float = 1.0  # [m] of all points
    max_cells: int = 5_000  # of a spline's band; larger takes more memory and time
    max_wall_cells: int = 12_000  # of a band whose cells are small because walls are thin
    small_cell: float = 0.9  # fraction of the requested edge; smaller cells were made for walls
    more_touches: float = 1.25  # ratio of touches, after which a draft tries wall cells again
    cells_per_square: float = 2.0  # expected cells of a band, per area of surface in cells^2
    max_voxels: float = 1.5e6  # of the coarse solid, without its padding
    excess: float = 1.15  # ratio of cells to `max_cells` that a fit still accepts
    dense: float = 12.0e-3  # [m] mean spacing of touches, below which drafts have final cells
    max_points: int = 30_000  # touched points; of more, every n-th point of a touch is used
    max_hull_points: int = 5_000  # used for the area of the hull


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplingSettings:
    """Voxels of the coarse solid, and the area of surface that each touched point stands for."""

    voxel: float = 0.57  # [cells] edge of a voxel
    spread: float = 0.35  # width of a point's kernel over the spacing of touches; larger bridges
    min_spread: float = 3.0e-3  # [m]
    max_spread: float = 12.0e-3  # [m]
    max_area: float = 1.5  # largest area of one point, over the hull's area per touch
    min_rounds: int = 2  # fits without an earlier solid; each weighs outliers by the one before
    flat: float = 1e-6  # [m] rms distance from a plane, below which points enclose no solid


@dataclass(frozen=True, slots=True, kw_only=True)
class WideningSettings:
    """How often, and when, the band is widened where the surface leaves it."""

    max_rounds: int = 2  # largest number of times that the band is widened
    max_missing: float = 0.0  # missing cells over cells of the band, up to which it stays as it is


@dataclass(frozen=True, slots=True, kw_only=True)
class BandSettings:
    """Which cells the spline covers; lengths in cells."""

    width: float = 1.0  # [cells] on both sides of the estimated surface; larger costs more
    foot: float = 0.5  # [cells] over the lowest touches, up to which the band has all inner cells
    lowest: float = 0.5  # [%] percentile of the points' heights; it is that of the lowest touches
    searched: float = 4.0  # [cells] from the coarse surface; nearer, an earlier spline decides
    # An earlier spline's surface is given up where it is farther outside the coarse solid, and
    # farther from touched points, than this: a lid over a hollow that a finger entered since.
    outside: float = 1.0  # [cells]
    untouched: float = 2.0  # [cells]
    lacked: float = 3.0  # [cells] from an earlier band; the coarse surface adds only cells beyond
    # In cells that fingers swept, farther than `untouched` from touched points, the coarse solid
    # has this standard deviation; larger lets the spline close cavities that were entered.
    swept: float = 1.0e-3  # [m]
    widening: WideningSettings = WideningSettings()
    draft_widening: WideningSettings = WideningSettings(max_rounds=1, max_missing=0.01)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpannedSettings:
    """How the spline is held behind places that a pad spans without contact."""

    weight: float = 0.2  # factor of such a place's residuals at first; a touched point has 1
    max_depth: float = 0.15e-3  # [m] places with the surface farther behind them are left out


@dataclass(frozen=True, slots=True, kw_only=True)
class UndersideSettings:
    """Where the underside of an object that was turned over is assumed flat until it is touched."""

    min_distance: float = 8.0e-3  # [m] from every touched point; larger assumes less
    weight: float = 0.2  # factor of such a place's residuals at first; a touched point has 1


@dataclass(frozen=True, slots=True, kw_only=True)
class SplineSettings:
    """The energy of the implicit spline, and how a solid and its mesh are made of the spline."""

    cell: float = 4.0e-3  # [m] edge of a cell of the final solid; larger is coarser and faster
    draft_cell: float = 5.0e-3  # [m] edge of a cell of a draft, and of the fit before a finer one
    point_error: float = 0.06e-3  # [m] standard deviation of a touched point
    normal_error: float = 0.2  # standard deviation of a component of its unit normal
    pose: float = 0.1e-3  # [m] standard deviation of a touch's displacement
    roughness_weight: float = 0.05  # [m] of squared third derivatives: larger is smoother
    cell_power: float = 3.0  # power of cell / `draft_cell` by which that weight is multiplied
    anchor_weight: float = 1e6  # [1/m^5] of the distance to the coarse solid, squared
    min_slope: float = 0.2  # least norm of a gradient by which a value is divided for a distance
    n_projections: int = 2  # steps of Newton's method onto the surface
    max_retreats: int = 20  # rounds in which vertices of crossing faces are moved back to the grid
    min_part: float = 0.02  # touched nodes over the most touched part's; less is left out
    local_reach: float = 12.0e-3  # [m] from a new touch, within which `update` changes the spline
    max_residual: float = 15.0e-3  # [m] limit of a distance from the solid in `touch_squares`


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtrusionSettings:
    """Surface outside the convex hull of all touched points: where it is cut off, and its error."""

    # Surface is a ripple of the spline, and is cut off, if its height over the hull is larger than
    # `cut_height` + `cut_slope` * distance from the nearest touched point. On cups and bowls with
    # walls of 2 and 3 mm this cuts 0.7 % of the surface, up to 5 mm high; on scanned objects none.
    cut_height: float = 1.5e-3  # [m]; larger cuts less
    cut_slope: float = 0.5  # height over distance; larger cuts less
    cut_distance: float = 8.0e-3  # [m] from a touched point, up to which ripples are cut off
    min_height: float = 1.0e-3  # [m] over the hull; the expected error is the height less this
    bound_factor: float = 1.5  # bound of 95 % over that error
    # The hull is computed of one point in each cube; the cube's edge is the larger of these two.
    grid: float = 2.0e-3  # [m]
    grid_share: float = 0.01  # fraction of the extent of the touched points
    n_pairs: int = 1_000_000  # pairs of a place and a hull face compared at a time: memory


@readable
@dataclass(frozen=True, slots=True, kw_only=True)
class GeneralSettings:
    """All that is tuned of a general solid, from its touched points to its mesh and its errors."""

    orientation: OrientationSettings = field(default=OrientationSettings())
    walls: WallSettings = field(default=WallSettings())
    grid: GridSettings = GridSettings()
    sampling: SamplingSettings = SamplingSettings()
    coarse: CoarseSettings = field(default=CoarseSettings())
    bands: BandSettings = BandSettings()
    spanned: SpannedSettings = SpannedSettings()
    underside: UndersideSettings = UndersideSettings()
    spline: SplineSettings = SplineSettings()
    bends: BendSettings = DEFAULT_BENDS
    fit: FitSettings = field(default=FitSettings())
    motions: MotionSettings = field(default=MotionSettings())
    errors: ErrorSettings = field(default=ErrorSettings())
    edges: EdgeSettings = field(default=EdgeSettings())
    protrusions: ProtrusionSettings = ProtrusionSettings()


DEFAULT_GENERAL = GeneralSettings()
