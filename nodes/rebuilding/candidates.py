"""The solids of one set of contours, probes and touches, which predicts better, and its message.

Messages are of a solid by slices, a general one, or the coarse superquadric.
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
from palpate.nodes.rebuilding.soundness import missing_error
from palpate.nodes.rebuilding.volume import MeshVolume
from palpate.nodes.specs.sensors import SENSING

if TYPE_CHECKING:
    from palpate.core.rebuild import GeneralSolid

    AnySolid = LatticeSolid | GeneralSolid

_NONE = np.zeros(0)
Goal = types.ModelGoal | types.PlanDone
NO_ARCHIVE = np.zeros(0, np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateSettings:
    """Which solid is published, and how finely it is meshed."""

    confidence_sigmas: float = (
        1.64  # [standard errors] by which a general solid must predict better
    )
    max_error_ratio: float = 0.5  # of a general solid's squared error to that of the slices
    coarse_tolerance: float = 5e-4  # [fraction of the size] of the mesh that sets the final spacing
    max_parts: int = 4  # of a general solid's cell along each edge: more change nothing visible
    hollow_depth: float = (
        0.4e-3  # [m] in a solid, at which a pad that touches nothing is an opening
    )


CANDIDATES = CandidateSettings()


def is_final(goal: Goal) -> bool:
    """Whether a goal asks for the final model."""
    return isinstance(goal, types.PlanDone) or goal.final


class Quality(NamedTuple):
    """How finely the final model is meshed."""

    faces: int  # Triangles, about, if it takes as many
    tolerance: float  # Of the size: distance of the mesh from the surface, at least
    parts: int  # Pieces of a general solid's cell along each of its edges, at least


# Faces cost computing here, in scoring and in files; they do not change the surface.
QUALITIES: Mapping[str, Quality] = {
    "draft": Quality(6_000, 5e-4, 1),
    "normal": Quality(45_000, 5e-5, 2),
    "fine": Quality(180_000, 1e-5, 4),
}


class FittedGeneral(NamedTuple):
    """A general solid, and of how many touches it was last fitted."""

    solid: GeneralSolid
    whole: int  # all of it
    anew: int  # from nothing
    underside: Floats | None = None  # Places on which it stood at first, if it was turned over


class Placements(NamedTuple):
    """How the object lay after each time that it was turned over."""

    poses: tuple[Pose, ...] = ()  # In the world, by contacts of the hand; as many as are known
    errors: tuple[float, ...] = ()  # How far each may be off along normals, root mean square [m]
    faults: tuple[str, ...] = ()  # What is wrong with them, a sentence each
    alternatives: tuple[tuple[Pose, ...], ...] = ()  # Of each: other poses that fit as well
    lost: tuple[str, ...] = ()  # Why the last one is not known, if it is not: a sentence


@dataclass(frozen=True, eq=False)
class Candidates:
    """The solids of one set, one of each method."""

    sliced: LatticeSolid | None  # The final one as a control lattice; None: slices make no solid
    general: FittedGeneral | None  # None where nothing was touched, or slices do
    touched: ContactPoints  # Of what they are made
    method: Literal["lattice", "thesis"] = "lattice"  # Of the solid of the slices
    why: str = ""  # Why slices make no solid, if they should
    rejected: tuple[str, ...] = ()  # Solids that were fitted and contradicted, and by what
    placements: Placements = field(default_factory=Placements)
    # How the touches of later sets were predicted, by the number of the set.
    predictions: dict[int, dict[str, Floats]] = field(default_factory=dict)

    @property
    def poses(self) -> tuple[Pose, ...]:
        """Of the object in each placement, by contacts of the hand and all touches."""
        poses = self.placements.poses
        motions = () if self.general is None else self.general.solid.motions
        moved = (pose @ one.inverse() for pose, one in zip(poses, motions, strict=False))
        return (*moved, *poses[len(motions) :])

    @cached_property
    def volume(self) -> MeshVolume:
        """The slices' solid, meshed for a look."""
        assert self.sliced is not None
        return MeshVolume(surface.grid_mesh(self.sliced.surface))

    def mesh_of(self, solid: AnySolid) -> Mesh | surface.SurfaceMesh:
        """A mesh for a look of one of the solids."""
        return self.volume.mesh if isinstance(solid, LatticeSolid) else solid.rough_mesh

    def predicted(self, number: int, touched: ContactPoints) -> dict[str, Floats]:
        """Mean square distance of each touch since from the solids, by method, m^2.

        `number` is that of the later set to which the touches belong.
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
        """The general solid if it surely predicted the same touches better, else slices."""
        whole = None if self.general is None else self.general.solid
        if self.sliced is None or whole is None:
            return self.sliced or whole
        sliced, general = (predicted.get(name, _NONE) for name in ("lattice", "general"))
        if not len(general) or len(sliced) != len(general):
            return self.sliced
        gain = sliced - general
        sure = gain.mean() > CANDIDATES.confidence_sigmas * gain.std() / np.sqrt(len(gain))
        much = general.mean() < CANDIDATES.max_error_ratio**2 * sliced.mean()
        return whole if sure and much else self.sliced

    def final_mesh(self, quality: Quality) -> surface.SurfaceMesh:
        """Of about as many triangles whatever the shape: a first mesh tells how fine."""
        assert self.sliced is not None
        coarse = CANDIDATES.coarse_tolerance * self.sliced.surface.size
        first = self.sliced.mesh(coarse)
        if len(first.faces) >= quality.faces:
            return first
        finer = coarse * len(first.faces) / quality.faces
        return self.sliced.mesh(max(finer, quality.tolerance * self.sliced.surface.size))


def shape_model(
    goal: Goal,  # Who asked for it
    candidates: Candidates,  # What was fitted; neither if there was nothing to rebuild
    solid: AnySolid | None,  # The one of these that is published
    predicted: Mapping[str, Floats],  # Mean square distances of new touches, by method, m^2
    untouched: UntouchedPlaces,  # Where pads touched nothing, far from all touches
    quality: Quality | None = None,  # Of the mesh, if it is the final one
    step: Steps = no_steps,  # Told which step begins
    rejected: tuple[str, ...] = (),  # Solids that were rejected instead, and why
    mistaken: float = 0.0,  # Error if the object lay in another way that fits as well, m
) -> types.ShapeModel:
    """The message for the solid that predicts better."""
    dropped = _dropped(candidates, len(goal.contours))
    final, missing = is_final(goal), 0.0
    parts: dict[str, Any] = {"vertices": np.zeros((0, 3)), "faces": np.zeros((0, 3), np.int32)}
    frame = IDENTITY_POSE
    if isinstance(solid, LatticeSolid):
        parts = _parts(solid, candidates, quality, step)
        frame = IDENTITY_POSE if solid.frame is None else solid.frame
    elif solid is not None:
        parts = _general_parts(solid, quality, step)
    volume = _volume(parts, candidates)
    if candidates.general is not None and solid is candidates.general.solid:
        with step("bound"):
            missing = math.hypot(missing_error(volume, candidates.touched), mistaken)
    return types.ShapeModel(
        number=goal.number,
        contours=goal.contours,
        probes=goal.probes,
        touches=goal.touches,
        robot_time=goal.robot_time,
        method=candidates.method if solid is candidates.sliced else "general",
        predicted={name: float(np.sqrt(found.mean())) for name, found in predicted.items()},
        dropped=tuple(goal.contours[which] for which in dropped),
        dropped_reasons=tuple(dropped.values()),
        missing=missing,
        placements=np.reshape([one.array for one in candidates.poses], (-1, 7)),
        placement_errors=np.array(candidates.placements.errors, np.float64),
        placement_faults=(*candidates.placements.faults, *candidates.placements.lost),
        openings=_openings(np.concatenate([untouched.openings, untouched.hanging]), volume),
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
    """Standard deviation of the surface and of its ends; null where the method states none."""
    if candidates.method == "thesis":
        return {"deviation": None}
    if not isinstance(solid, LatticeSolid):
        return {"deviation": 0.0}
    with step("bound"):
        stated = solid.whole_deviation()
    assert stated is not None
    return {"deviation": stated.whole, "ends_deviation": stated.ends}


def _dropped(candidates: Candidates, count: int) -> dict[int, str]:
    """Which of so many contours were not used, and why."""
    if candidates.sliced is not None:
        return {one.which: one.why for one in candidates.sliced.slices.dropped}
    return dict.fromkeys(range(count), candidates.why) if candidates.why else {}


def _volume(parts: Mapping[str, Any], candidates: Candidates) -> MeshVolume:
    """What a model's mesh encloses: the candidates' own if it is theirs."""
    if candidates.sliced is not None and parts["faces"] is candidates.volume.mesh.faces:
        return candidates.volume
    return MeshVolume(Mesh(parts["vertices"], parts["faces"]))


def _openings(untouched: Floats, volume: MeshVolume) -> Floats:
    """Places (k, 3) of those without touch where a solid would have been touched, m.

    It is hollow there: else it would be, for the pad has been where the solid is said to be.
    """
    if not len(untouched) or not len(volume.mesh.faces):
        return np.zeros((0, 3))
    return untouched[volume.depths(untouched) > CANDIDATES.hollow_depth]


def _errors(
    vertices: Floats, candidates: Candidates, untouched: UntouchedPlaces, step: Steps
) -> dict[str, Any]:
    """Distance from touch at each vertex, and the error that it lets expect, if that is known."""
    touched, general = candidates.touched, candidates.general
    if not len(touched.points) and general is not None:
        touched = general.solid.contacts  # of the hand
    if not len(touched.points) or not len(vertices):
        return {}
    with step("bound"):
        distances = touch_distances(touched, vertices)
        errors = bounds = np.zeros_like(distances)  # slices tell of theirs by height
        if general is not None:
            errors, bounds = general.solid.expected_errors(vertices)
            bounds = np.maximum(bounds, untouched.slopes_at(vertices) * distances)
        return {"vertex_distances": distances, "vertex_errors": errors, "vertex_bounds": bounds}


def _checked(vertices: Floats, faces: Ints, step: Steps) -> dict[str, Any]:
    """What kind of surface the final mesh is, before anybody writes it."""
    if not len(faces):
        return {}
    with step("mesh"):
        body = solidity(vertices, faces)
        crossings = self_intersection(vertices, faces).count
    return {"closed": body.watertight, "genus": body.genus, "self_crossings": crossings}


def _general_parts(solid: GeneralSolid, quality: Quality | None, step: Steps) -> dict[str, Any]:
    with step("mesh"):
        mesh = solid.rough_mesh
        if quality is not None:
            most = int(np.sqrt(quality.faces / max(len(mesh.faces), 1)))
            mesh = solid.mesh(min(max(most, quality.parts), CANDIDATES.max_parts))
    health = _rounded(solid.health())
    return {"vertices": mesh.vertices, "faces": mesh.faces, "health": health}


def _rounded(health: Mapping[str, float]) -> dict[str, float]:
    """To digits that do not depend on the machine, so that bodies do not."""
    return {name: float(f"{value:.2g}") for name, value in health.items()}


def _parts(
    solid: LatticeSolid, candidates: Candidates, quality: Quality | None, step: Steps
) -> dict[str, Any]:
    """Everything of a model that is the solid's; without a quality its mesh is coarse."""
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
    number: int, contacts: Floats, *, three_shapes: bool = False
) -> types.Superquadric:
    """The message for the superquadric through contacts (n, 3), m.

    `three_shapes`: the best of a sphere, a box and a cylinder, neither tapered nor bent.
    """
    if three_shapes:
        fitted = recover(contacts, choice="thesis", noise=SENSING.contact_error)
    else:
        fitted = fit_coarse(contacts, SENSING.contact_error)
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
