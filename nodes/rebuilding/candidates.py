"""The candidate solids of one set of contours and probes, the choice between them, and its message.

The message describes a solid in slices, a general solid, or the coarse superquadric.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from palpate.core.archive import tree_to_bytes
from palpate.core.arrays import Floats, Ints
from palpate.core.explore import UntouchedPlaces
from palpate.core.geometry import nearest_points, self_intersection, solidity
from palpate.core.poses import IDENTITY_POSE, Pose
from palpate.core.rebuild import LatticeSolid, fit_coarse, lattice as lattices, recover, surface
from palpate.core.rebuild.contours import ContactPoints
from palpate.core.rebuild.general import touch_distances, touch_squares
from palpate.core.shapes import Mesh
from palpate.core.steps import Steps, no_steps
from palpate.messages import types
from palpate.nodes.rebuilding.settings import DEFAULT_RECONSTRUCTOR, ReconstructorSettings
from palpate.nodes.rebuilding.soundness import missing_error
from palpate.nodes.rebuilding.volume import MeshVolume
from palpate.nodes.specs.sensors import DEFAULT_SENSING, SensingSettings

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid

    AnySolid = LatticeSolid | GeneralSolid

_NONE = np.zeros(0)
Goal = types.ModelGoal | types.PlanDone
NO_ARCHIVE = np.zeros(0, np.uint8)


def is_final(goal: Goal) -> bool:
    """Whether a goal asks for the final model."""
    return isinstance(goal, types.PlanDone) or goal.final


class Quality(NamedTuple):
    """How finely the final model is meshed."""

    faces: int  # approximate number of triangles; fewer if `tolerance` is reached first
    tolerance: float  # minimum distance of the mesh from the surface [fraction of the size]
    parts: int  # minimum number of pieces along each edge of a general solid's cell


# More faces cost time in meshing and scoring, and space in files; the surface is the same.
QUALITIES: Mapping[str, Quality] = {
    "draft": Quality(6_000, 5e-4, 1),
    "normal": Quality(45_000, 5e-5, 2),
    "fine": Quality(180_000, 1e-5, 4),
}


class FittedGeneral(NamedTuple):
    """A general solid, and the numbers of touches at its last complete fits."""

    solid: GeneralSolid
    whole: int  # number of touches when all of it was last fitted
    anew: int  # number of touches when it was last fitted without an earlier solid
    underside: Floats | None = None  # places (k, 3) that it stood on at first, if turned over [m]


class Placements(NamedTuple):
    """The poses of the object after each time that it was turned over."""

    poses: tuple[Pose, ...] = ()  # known poses in the world, from contacts of the hand
    errors: tuple[float, ...] = ()  # rms error of each pose along the normals at contacts [m]
    faults: tuple[str, ...] = ()  # faults of the poses, a sentence each
    alternatives: tuple[tuple[Pose, ...], ...] = ()  # for each pose, others that fit as well
    lost: tuple[str, ...] = ()  # why the next pose is unknown, in a sentence; empty if none failed


@dataclass(frozen=True, eq=False)
class Candidates:
    """The solids of one set, at most one of each method."""

    sliced: LatticeSolid | None  # has a control lattice if final; None if slices make no solid
    general: FittedGeneral | None  # None if nothing was touched, or if slices make a solid
    touched: ContactPoints  # the contacts to which the solids are fitted
    method: Literal["lattice", "thesis"] = "lattice"  # of the solid in slices
    why: str = ""  # why requested slices make no solid
    rejected: tuple[str, ...] = ()  # solids that contacts or swept space contradict, with reasons
    placements: Placements = field(default_factory=Placements)
    # Squared errors of predictions of later sets, by number of the set, then method [m^2].
    predictions: dict[int, dict[str, Floats]] = field(default_factory=dict)
    settings: ReconstructorSettings = DEFAULT_RECONSTRUCTOR

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Poses of the object in each placement, corrected by the fit of all touches."""
        poses = self.placements.poses
        motions = () if self.general is None else self.general.solid.motions
        moved = (pose @ motion.inverse() for pose, motion in zip(poses, motions, strict=False))
        return (*moved, *poses[len(motions) :])

    @cached_property
    def volume(self) -> MeshVolume:
        """The volume of a coarse mesh of the solid in slices."""
        assert self.sliced is not None
        return MeshVolume(surface.grid_mesh(self.sliced.surface))

    def mesh_of(self, solid: AnySolid) -> Mesh | surface.SurfaceMesh:
        """A coarse mesh of one of the solids."""
        return self.volume.mesh if isinstance(solid, LatticeSolid) else solid.rough_mesh

    def predicted(self, number: int, touched: ContactPoints) -> dict[str, Floats]:
        """Mean square distance of each later touch from the solids, by method [m^2].

        `number`: of the later set to which the touches belong. Results are kept by this number.
        """
        if number not in self.predictions:
            self.predictions[number] = self._predicted(touched)
        return self.predictions[number]

    def _predicted(self, touched: ContactPoints) -> dict[str, Floats]:
        squares = {}
        if self.sliced is not None:
            off = nearest_points(self.volume.search, touched.points).distances
            squares["lattice"] = touch_squares(touched, off)
        if self.general is not None:
            off = self.general.solid.residuals(touched.points)
            squares["general"] = touch_squares(touched, off)
        return squares

    def better(self, predicted: Mapping[str, Floats]) -> AnySolid | None:
        """The general solid if it predicted the same touches significantly better, else slices."""
        general_solid = None if self.general is None else self.general.solid
        if self.sliced is None or general_solid is None:
            return self.sliced or general_solid
        sliced, general = (predicted.get(name, _NONE) for name in ("lattice", "general"))
        if not len(general) or len(sliced) != len(general):
            return self.sliced
        gain, settings = sliced - general, self.settings.candidates
        is_sure = gain.mean() > settings.confidence_sigmas * gain.std() / np.sqrt(len(gain))
        is_large = general.mean() < settings.max_error_ratio**2 * sliced.mean()
        return general_solid if is_sure and is_large else self.sliced

    def final_mesh(self, quality: Quality) -> surface.SurfaceMesh:
        """The final mesh, of about `quality.faces` triangles: a coarse mesh sets its tolerance."""
        assert self.sliced is not None
        coarse = self.settings.candidates.coarse_tolerance * self.sliced.surface.size
        first = self.sliced.mesh(coarse)
        if len(first.faces) >= quality.faces:
            return first
        finer = coarse * len(first.faces) / quality.faces
        return self.sliced.mesh(max(finer, quality.tolerance * self.sliced.surface.size))


def shape_model(
    goal: Goal,  # request for the model
    candidates: Candidates,  # fitted solids; there are none if there was nothing to rebuild
    solid: AnySolid | None,  # the published candidate
    predicted: Mapping[str, Floats],  # mean square distances of new touches, by method [m^2]
    untouched: UntouchedPlaces,  # where pads touched nothing, far from all touches
    quality: Quality | None = None,  # of the final mesh; None for a coarse mesh
    step: Steps = no_steps,  # measures the time of each step
    rejected: tuple[str, ...] = (),  # rejected solids, with reasons
    mistaken: float = 0.0,  # rms error if the object's pose after a turn is wrong [m]
) -> types.ShapeModel:
    """The message for the published solid."""
    settings, dropped = candidates.settings.candidates, _dropped(candidates, len(goal.contours))
    parts: dict[str, Any] = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    final, frame = is_final(goal), IDENTITY_POSE
    if isinstance(solid, LatticeSolid):
        parts = _parts(solid, candidates, quality, step)
        frame = IDENTITY_POSE if solid.frame is None else solid.frame
    elif solid is not None:
        parts = _general_parts(solid, quality, settings.max_parts, step)
    volume = _volume(parts, candidates)
    return types.ShapeModel(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        touches=goal.touches,
        robot_time=goal.robot_time,
        method=candidates.method if solid is candidates.sliced else "general",
        predicted={name: float(np.sqrt(squares.mean())) for name, squares in predicted.items()},
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_reasons=tuple(dropped.values()),
        missing=_missing(solid, candidates, volume, mistaken, step),
        placements=np.reshape([pose.array for pose in candidates.poses], (-1, 7)),
        placement_errors=np.array(candidates.placements.errors, np.float64),
        placement_faults=(*candidates.placements.faults, *candidates.placements.lost),
        openings=_openings(untouched, volume, settings.hollow_depth),
        frame=frame,
        **_deviations(solid, candidates, step),
        **parts,
        **_errors(parts["vertices"], candidates, untouched, step),
        **(_checked(parts["vertices"], parts["faces"], step) if final else {}),
        rejected=rejected,
        final=final,
        archive=tree_to_bytes(solid) if solid is not None and final else NO_ARCHIVE,
    )


def _deviations(solid: AnySolid | None, candidates: Candidates, step: Steps) -> dict[str, Any]:
    """Standard deviations of the surface and its ends [m]; None if the method states none."""
    if candidates.method == "thesis":
        return {"deviation": None}
    if not isinstance(solid, LatticeSolid):
        return {"deviation": 0.0}
    with step("bound"):
        stated = solid.whole_deviation()
    assert stated is not None
    return {"deviation": stated.whole, "ends_deviation": stated.ends}


def _dropped(candidates: Candidates, count: int) -> dict[int, str]:
    """Indices of unused contours, of `count` in all, with reasons."""
    if candidates.sliced is not None:
        return {dropped.which: dropped.why for dropped in candidates.sliced.slices.dropped}
    return dict.fromkeys(range(count), candidates.why) if candidates.why else {}


def _volume(parts: Mapping[str, Any], candidates: Candidates) -> MeshVolume:
    """The volume of a model's mesh; that of the candidates is used if it has the same mesh."""
    if candidates.sliced is not None and parts["faces"] is candidates.volume.mesh.faces:
        return candidates.volume
    return MeshVolume(Mesh(parts["vertices"], parts["faces"]))


def _missing(
    solid: AnySolid | None, candidates: Candidates, volume: MeshVolume, mistaken: float, step: Steps
) -> float:
    """Rms error of a general solid from parts that it lacks and from a `mistaken` pose [m]."""
    if candidates.general is None or solid is not candidates.general.solid:
        return 0.0
    with step("bound"):
        missing = missing_error(volume, candidates.touched, candidates.settings.soundness)
        return math.hypot(missing, mistaken)


def _openings(untouched: UntouchedPlaces, volume: MeshVolume, min_depth: float) -> Floats:
    """Untouched places (k, 3) that lie deeper than `min_depth` inside a solid [m].

    The object is hollow there: the pad was at these places and met nothing.
    """
    places = np.concatenate([untouched.openings, untouched.hanging])
    if not len(places) or not len(volume.mesh.faces):
        return np.zeros((0, 3))
    return places[volume.depths(places) > min_depth]


def _errors(
    vertices: Floats, candidates: Candidates, untouched: UntouchedPlaces, step: Steps
) -> dict[str, Any]:
    """At each vertex: distance from touches, expected error and its bound; empty if unknown [m]."""
    touched, general = candidates.touched, candidates.general
    if not len(touched.points) and general is not None:
        touched = general.solid.contacts  # of the hand
    if not len(touched.points) or not len(vertices):
        return {}
    with step("bound"):
        distances = touch_distances(touched, vertices)
        errors = bounds = np.zeros_like(distances)  # errors of slices are stated by height
        if general is not None:
            errors, bounds = general.solid.expected_errors(vertices)
            bounds = np.maximum(bounds, untouched.slopes_at(vertices) * distances)
        return {"vertex_distances": distances, "vertex_errors": errors, "vertex_bounds": bounds}


def _checked(vertices: Floats, faces: Ints, step: Steps) -> dict[str, Any]:
    """Closedness, genus and self-crossings of the final mesh; empty without faces."""
    if not len(faces):
        return {}
    with step("mesh"):
        body = solidity(vertices, faces)
        crossings = self_intersection(vertices, faces).count
    return {"closed": body.watertight, "genus": body.genus, "self_crossings": crossings}


def _general_parts(
    solid: GeneralSolid, quality: Quality | None, max_parts: int, step: Steps
) -> dict[str, Any]:
    with step("mesh"):
        mesh = solid.rough_mesh
        if quality is not None:
            parts = int(np.sqrt(quality.faces / max(len(mesh.faces), 1)))
            mesh = solid.mesh(min(max(parts, quality.parts), max_parts))
    health = _rounded(solid.health())
    return {"vertices": mesh.vertices, "faces": mesh.faces, "health": health}


def _rounded(health: Mapping[str, float]) -> dict[str, float]:
    """Figures with two digits, which are the same on all machines, as messages must be."""
    return {name: float(f"{value:.2g}") for name, value in health.items()}


def _parts(
    solid: LatticeSolid, candidates: Candidates, quality: Quality | None, step: Steps
) -> dict[str, Any]:
    """Fields of a model that describe a solid in slices; without `quality` its mesh is coarse."""
    lattice: dict[str, Floats] = {}
    with step("mesh"):
        mesh = candidates.volume.mesh if quality is None else candidates.final_mesh(quality)
        if solid.control_lattice is not None:
            grid = lattices.lattice_grid(solid.control_lattice)
            names = "knots_columns", "knots_rows", "knots_layers"
            lattice = {"control": grid.control, "undeformed": grid.undeformed}
            lattice |= dict(zip(names, grid.knots, strict=True))
    if solid.side is not None:
        with step("bound"):
            heights, deviation = solid.side.band()
            lattice |= {"uncertainty_height": heights, "uncertainty": deviation}
    shape = {"vertices": mesh.vertices, "faces": mesh.faces, "health": _rounded(solid.health())}
    return lattice | shape


def coarse_model(
    number: int,
    contacts: Floats,
    *,
    three_shapes: bool = False,
    settings: SensingSettings = DEFAULT_SENSING,
) -> types.Superquadric:
    """The message for the superquadric fitted to contacts (n, 3) [m].

    `three_shapes`: fit the best of a sphere, a box and a cylinder, neither tapered nor bent.
    """
    if three_shapes:
        fitted = recover(contacts, choice="thesis", noise=settings.contact_error)
    else:
        fitted = fit_coarse(contacts, settings.contact_error)
    return types.Superquadric(
        number=number,
        size=fitted.size,
        exponents=fitted.exponents,
        pose=fitted.pose,
        taper=fitted.taper,
        bend=fitted.bend.curvature,
        bend_direction=fitted.bend.direction,
        warnings=fitted.warnings,
        residual=fitted.rms,
        residuals=fitted.residuals,
        rank=fitted.rank,
    )
