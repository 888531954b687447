"""Grasping by Containment: a hand that closes on the object, and the superquadric it contains.

Allen's first exploratory procedure (Fung, 1999, 1.4.3.2): 30 to 100 contacts from several poses of
the hand, to which Solina and Bajcsy's superquadric is fitted, tapered and bent. In the text the
user chooses the poses; here each closing is where most is expected to be learned, and a fit is
accepted once it predicts contacts that it was not fitted to.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.explore.grasp import (
    Hand,
    HandSettings,
    brought_near,
    next_pose,
    search_places,
    search_pose,
)
from palpate.core.geometry import nearest_points, nearest_search
from palpate.core.poses import Pose
from palpate.core.procedures.protocol import (
    Exploration,
    Findings,
    HandMove,
    Move,
    MoveResult,
    TouchSetup,
    close,
)
from palpate.core.rebuild import fit_coarse
from palpate.core.rebuild.recovery import Recovery
from palpate.core.shapes import FittedSuperquadric


@dataclass(frozen=True, slots=True, kw_only=True)
class ContainmentSettings:
    """How many contacts the hand makes, and when the fitted superquadric is accepted."""

    min_contacts: int = 30  # by the text
    max_contacts: int = 100  # by the text
    n_predicted: int = 12  # contacts, made after a fit, that the fit must predict
    # [m] added to the allowed distance of a predicted contact, for the mesh's facets, and for rims
    # that are sharper than the superquadric's exponents allow.
    prediction_tolerance: float = 0.2e-3
    max_closings: int = 80  # after the first contact
    hand_size: float = 0.8  # fraction of the fingers' reach: opening and reach of the hand
    palm_depth: float = 8.0e-3  # [m] below the fitted top, down to which the palm searches for it
    max_overhang: float = 6.0e-3  # [m] of the solid beyond all contacts
    down_cosine: float = -0.7  # z part of an axis's end; below it, the end needs no contact
    facing_cosine: float = 0.5  # between an end's axis and the normal of a contact that touches it
    max_stand_fits: int = 4  # repetitions of the fit, to stand the solid on the platform
    foot_height: float = 1.0e-3  # [m] thickness of the layer that is a solid's foot, or its top
    mesh_level: int = 5  # of the tessellation of a fit; finer if larger


def containment(
    setup: TouchSetup, contacts: int = 60, settings: ContainmentSettings = ContainmentSettings()
) -> Exploration:
    """Close the hand until there are enough contacts, and fit a tapered, bent superquadric.

    `contacts`: 30 to 100, else ValueError; 60 determine taper and bend. The hand then closes where
    the fit is untouched: contacts that the fit did not predict are added and the fit is repeated,
    up to 100 contacts. Findings: the recovered superquadric, or ``unsuited`` where contacts are
    off it by more than three standard deviations.
    """
    least, most = settings.min_contacts, settings.max_contacts
    if not least <= contacts <= most:
        raise ValueError(f"contacts must be from {least} to {most}, got {contacts}")
    grasp = _Grasp(setup, settings)
    yield from grasp.until(contacts)
    while len(grasp.points) >= least:
        fit = standing_fit(setup, grasp.points, settings)
        n_before = len(grasp.points)
        yield from grasp.from_above(fit)
        if grasp.is_hollow:
            depth = 1e3 * settings.palm_depth
            reason = f"it is hollow: the palm goes {depth:.0f} mm below its top and meets nothing"
            return Findings(status="unsuited", reason=reason)
        yield from grasp.until(n_before + settings.n_predicted)
        offsets = _distances(fit, grasp.points[n_before:], settings.mesh_level)
        few = len(offsets) < settings.n_predicted // 2
        if few or len(grasp.points) >= most or offsets.max() <= _max_offset(setup, settings):
            return _findings(grasp, offsets)
    reason = f"the hand made {len(grasp.points)} contacts within reach, {least} are needed"
    return Findings(status="incomplete", reason=reason)


class _Grasp:
    """The hand, and all contacts that it has made."""

    def __init__(self, setup: TouchSetup, settings: ContainmentSettings) -> None:
        self.setup, self.settings = setup, settings
        size = settings.hand_size * setup.reach
        self.hand = Hand(opening=size, reach=size)
        self.points, self.normals = np.zeros((0, 3)), np.zeros((0, 3))
        self.n_searched = self.n_closings = 0
        self.is_hollow = False  # whether the palm touched nothing where the top should be

    def until(self, n_contacts: int) -> Generator[Move, MoveResult, None]:
        """Close the hand until there are `n_contacts`, or no closing is left."""
        while len(self.points) < n_contacts and self.n_closings < self.settings.max_closings:
            move = self._next_move()
            if move is None:
                return
            yield from self._close(move)

    def from_above(self, fit: FittedSuperquadric) -> Generator[Move, MoveResult, None]:
        """Close the hand over the middle of a fit's top, and see whether the palm touches it."""
        settings = self.settings
        try:
            vertices = fit.shape().mesh(settings.mesh_level).vertices
        except ValueError:
            return
        top = float(vertices[:, 2].max())
        middle = vertices[vertices[:, 2] >= top - settings.foot_height].mean(axis=0)
        height = top - settings.palm_depth - HandSettings().search_heights[0]
        pose = search_pose([middle[:2]], 0, height)
        assert pose is not None
        fingers = yield from self._close(HandMove(self.hand, pose))
        self.is_hollow = self.hand.fingers not in fingers

    def _close(self, move: HandMove) -> Generator[Move, MoveResult, set[int]]:
        """Close the hand and keep its contacts; the fingers that made one, the palm last."""
        contacts = yield from close(move)
        self.points = np.concatenate([self.points, contacts.points])
        self.normals = np.concatenate([self.normals, contacts.normals])
        return set(contacts.fingers.tolist())

    def _next_move(self) -> HandMove | None:
        setup, known = self.setup, (self.points, self.normals, self.setup.platform)
        if len(self.points):
            self.n_closings += 1
            pose = next_pose(self.hand, *known)
            return HandMove(brought_near(self.hand, pose, *known), pose)
        places = search_places(setup.reach, setup.common.search_spacing)
        searched = search_pose(places, self.n_searched, setup.platform)
        self.n_searched += 1
        return None if searched is None else HandMove(self.hand, searched)


def standing_fit(
    setup: TouchSetup, points: Floats, settings: ContainmentSettings = ContainmentSettings()
) -> Recovery:
    """The superquadric through contacts (n, 3) [m] that stands on the platform.

    A hand does not reach under the object: where the fit ends above or below the platform, its
    lowest place is added as a contact at the platform's height.
    """
    fit = fit_coarse(points, setup.sigma)
    if fit.rms > setup.common.max_rms * setup.sigma:
        return fit
    for _ in range(settings.max_stand_fits):
        try:
            vertices = fit.shape().mesh(settings.mesh_level).vertices
        except ValueError:
            return fit
        heights = vertices[:, 2] - setup.platform
        if abs(float(heights.min())) <= setup.sigma:
            break
        foot = vertices[heights <= heights.min() + settings.foot_height].mean(axis=0)
        foot[2] = setup.platform
        fit = fit_coarse(np.concatenate([points, foot[None]]), setup.sigma)
    return fit


def _distances(fit: FittedSuperquadric, points: Floats, mesh_level: int) -> Floats:
    """Distances (n,) of contacts from a fit [m]; infinite if it folds."""
    try:
        vertices, faces = fit.shape().mesh(mesh_level)
    except ValueError:
        return np.full(len(points), math.inf)
    return np.asarray(nearest_points(nearest_search(vertices[faces]), points).distances)


def _max_offset(setup: TouchSetup, settings: ContainmentSettings) -> float:
    """Largest distance of a predicted contact from the fit [m]."""
    return setup.common.max_rms * setup.sigma + settings.prediction_tolerance


def _findings(grasp: _Grasp, offsets: Floats) -> Findings:
    """The superquadric through all contacts, unless they refute it.

    `offsets` (n,): distances of the last contacts from the fit before them [m].
    """
    setup, settings, points = grasp.setup, grasp.settings, grasp.points
    sigma, fit = setup.sigma, standing_fit(setup, points, settings)
    prediction_rms = float(np.sqrt(np.mean(offsets**2))) if len(offsets) else 0.0
    worst = float(offsets.max(initial=0.0))
    figures = {"contacts": float(len(points)), "residual_rms_m": fit.rms}
    if math.isfinite(prediction_rms):
        figures |= {"foretold_rms_m": prediction_rms, "foretold_worst_m": worst}
    if fit.rms > setup.common.max_rms * sigma:
        reason = (
            f"no superquadric contains it: contacts are {1e3 * fit.rms:.3f} mm rms off the best "
            f"one, tapered and bent, where one standard deviation is {1e3 * sigma:.3f} mm"
        )
        return Findings(status="unsuited", reason=reason, figures=figures)
    few = len(offsets) < settings.n_predicted // 2
    if not fit.fitted or few or worst > _max_offset(setup, settings):
        reason = (
            f"{len(points)} contacts do not determine a superquadric: the last {len(offsets)} are "
            f"up to {1e3 * worst:.1f} mm off the fit before them"
        )
        return Findings(status="incomplete", reason=reason, figures=figures)
    overhang = _overhang(fit, points, settings)
    if overhang > settings.max_overhang or _n_untouched_sides(fit, grasp.normals, settings):
        reason = f"its ends are not touched: {1e3 * overhang:.0f} mm of it lie beyond all contacts"
        return Findings(status="incomplete", reason=reason, figures=figures)
    reason = (
        f"a superquadric fits {len(points)} contacts to {1e3 * fit.rms:.3f} mm rms, and predicts "
        f"the last {len(offsets)} to {1e3 * worst:.3f} mm"
    )
    mesh = fit.shape().mesh(settings.mesh_level)
    return Findings(status="done", reason=reason, shape=fit, mesh=mesh, figures=figures)


def _overhang(fit: FittedSuperquadric, points: Floats, settings: ContainmentSettings) -> float:
    """How far the solid lies beyond contacts (n, 3), except downwards [m].

    Along the solid's own axes, or half of it along the world's: corners that point along no axis
    of the solid lie beyond the contacts.
    """
    position, axes = Pose.from_array(fit.pose)
    local = (points - position) @ axes
    touched = np.stack([local.max(axis=0), -local.min(axis=0)])
    is_down = _downward(axes, settings.down_cosine)
    along_own = np.where(is_down, 0.0, fit.size - touched).max()
    vertices = fit.shape().mesh(settings.mesh_level).vertices
    above = vertices.max(axis=0) - points.max(axis=0)
    below = points.min(axis=0) - vertices.min(axis=0)
    return float(max(along_own, 0.5 * above.max(), 0.5 * below[:2].max()))


def _n_untouched_sides(
    fit: FittedSuperquadric, normals: Floats, settings: ContainmentSettings
) -> int:
    """Number of the solid's sides, except the lower one, that no contact's normal (n, 3) faces."""
    axes = Pose.from_array(fit.pose).axes
    cosines, least = normals @ axes, settings.facing_cosine
    touched = np.stack([(cosines > least).any(axis=0), (cosines < -least).any(axis=0)])
    return int((~(touched | _downward(axes, settings.down_cosine))).sum())


def _downward(axes: Floats, down_cosine: float) -> Bools:
    """Which ends (2, 3) of three axes, as columns, point to the platform, where no contact is."""
    return np.asarray(np.stack([axes[2], -axes[2]]) < down_cosine)
