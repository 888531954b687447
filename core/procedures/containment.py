"""Grasping by Containment: a hand that closes on the object, and the superquadric it contains.

Allen's first exploratory procedure (Fung, 1999, 1.4.3.2): 30 to 100 contacts from several poses of
the hand, through which Solina and Bajcsy's superquadric is fitted, tapered and bent. The text's
hand takes poses that its user chose; here each closing is where it is expected to tell most, and a
fit is believed once it has foretold contacts that it did not know.
"""

from __future__ import annotations

import math
from collections.abc import Generator

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
    SEARCH_SPACING,
    UNSUITED,
    Exploration,
    Findings,
    HandMove,
    Met,
    Move,
    TouchSetting,
    close,
)
from palpate.core.rebuild import fit_coarse
from palpate.core.rebuild.recovery import Recovery
from palpate.core.shapes import FittedSuperquadric

FEWEST, MOST = 30, 100  # Contacts, as the text has them
CONTACTS = 60  # As many as tell taper and bend
# Contacts by which a fit is tried, and how far off one may be beside its error: the mesh's facets,
# and rims that exponents follow only so far, m.
FORETOLD, FORETOLD_ROOM = 12, 0.2e-3
MOST_CLOSINGS = 80  # Once something was met
OPENING = 0.8  # Of the reach
UNDER = 8.0e-3  # Below the expected top, m: so far the palm comes from above
BEYOND = 6.0e-3  # Along an axis of the solid, m: so far it may reach beyond all contacts
# Rise of an axis that leads to the platform, where no contact can be, and cosine of what faces it.
DOWN, FACING = -0.7, 0.5
MOST_FEET, FOOT = 4, 1.0e-3  # Refits to the platform, and height of what is lowest, m
MESH_LEVEL = 5


def containment(setting: TouchSetting, contacts: int = CONTACTS) -> Exploration:
    """Close the hand until there are so many contacts, and fit a tapered, bent superquadric.

    `contacts`: 30 to 100. Then the hand closes where the fit has not been touched yet: what it
    meets there must be foretold, else it counts and the fit is made anew, up to 100 contacts.
    Findings: the recovered superquadric, or ``unsuited`` where contacts are off it by more than
    three standard deviations. Raises ValueError for another number.
    """
    if not FEWEST <= contacts <= MOST:
        raise ValueError(f"contacts must be from {FEWEST} to {MOST}, got {contacts}")
    grasp, wanted = _Grasp(setting), contacts
    yield from grasp.until(wanted)
    while len(grasp.points) >= FEWEST:
        found = standing_fit(setting, grasp.points)
        before = len(grasp.points)
        yield from grasp.from_above(found)
        if grasp.hollow:
            why = (
                f"it is hollow: the palm goes {1e3 * UNDER:.0f} mm below its top and meets nothing"
            )
            return Findings(status="unsuited", reason=why)
        yield from grasp.until(before + FORETOLD)
        off = _distances(found, grasp.points[before:])
        if len(off) < FORETOLD // 2 or len(grasp.points) >= MOST or off.max() <= _worst(setting):
            return _findings(setting, grasp, off)
    why = f"the hand made {len(grasp.points)} contacts within reach, {FEWEST} are needed"
    return Findings(status="incomplete", reason=why)


class _Grasp:
    """What the hand has met so far."""

    def __init__(self, setting: TouchSetting) -> None:
        self.setting = setting
        self.hand = Hand(opening=OPENING * setting.reach, reach=OPENING * setting.reach)
        self.points, self.normals = np.zeros((0, 3)), np.zeros((0, 3))
        self.searched = self.closings = 0
        self.hollow = False  # Whether the palm met nothing where the top should be

    def until(self, wanted: int) -> Generator[Move, Met, None]:
        """Close the hand until there are so many contacts, or it finds no more."""
        while len(self.points) < wanted and self.closings < MOST_CLOSINGS:
            move = self._next()
            if move is None:
                return
            met = yield from close(move)
            self.points = np.concatenate([self.points, met.points])
            self.normals = np.concatenate([self.normals, met.normals])

    def from_above(self, found: FittedSuperquadric) -> Generator[Move, Met, None]:
        """Close the hand over the middle of a fit's top: the palm falls into what is hollow."""
        try:
            vertices = found.shape().mesh(MESH_LEVEL).vertices
        except ValueError:
            return
        top = float(vertices[:, 2].max())
        middle = vertices[vertices[:, 2] >= top - FOOT].mean(axis=0)
        pose = search_pose([middle[:2]], 0, top - UNDER - HandSettings().search_heights[0])
        assert pose is not None
        met = yield from close(HandMove(self.hand, pose))
        self.hollow = self.hand.fingers not in met.fingers
        self.points = np.concatenate([self.points, met.points])
        self.normals = np.concatenate([self.normals, met.normals])

    def _next(self) -> HandMove | None:
        known = self.points, self.normals, self.setting.platform
        if len(self.points):
            self.closings += 1
            pose = next_pose(self.hand, *known)
            return HandMove(brought_near(self.hand, pose, *known), pose)
        places = search_places(self.setting.reach, SEARCH_SPACING)
        found = search_pose(places, self.searched, self.setting.platform)
        self.searched += 1
        return None if found is None else HandMove(self.hand, found)


def standing_fit(setting: TouchSetting, points: Floats) -> Recovery:
    """The superquadric through contacts (n, 3), m, that stands on the platform.

    A hand does not reach under the object: where the fit ends above the platform or below it, the
    place where it is lowest is taken for a contact at the platform's height.
    """
    found = fit_coarse(points, setting.sigma)
    for _ in range(MOST_FEET if found.rms <= UNSUITED * setting.sigma else 0):
        try:
            vertices = found.shape().mesh(MESH_LEVEL).vertices
        except ValueError:
            return found
        heights = vertices[:, 2] - setting.platform
        if abs(float(heights.min())) <= setting.sigma:
            break
        foot = vertices[heights <= heights.min() + FOOT].mean(axis=0)
        foot[2] = setting.platform
        found = fit_coarse(np.concatenate([points, foot[None]]), setting.sigma)
    return found


def _distances(found: FittedSuperquadric, points: Floats) -> Floats:
    """Distances (n,) of contacts from a fit, m; infinite if it folds."""
    try:
        vertices, faces = found.shape().mesh(MESH_LEVEL)
    except ValueError:
        return np.full(len(points), math.inf)
    return np.asarray(nearest_points(nearest_search(vertices[faces]), points).distances)


def _worst(setting: TouchSetting) -> float:
    """How far off a contact may be that a fit has foretold, m."""
    return UNSUITED * setting.sigma + FORETOLD_ROOM


def _findings(setting: TouchSetting, grasp: _Grasp, off: Floats) -> Findings:
    """The superquadric through all contacts, unless they refute it; the last are `off`, m."""
    points = grasp.points
    sigma, found = setting.sigma, standing_fit(setting, points)
    foretold = float(np.sqrt(np.mean(off**2))) if len(off) else 0.0
    figures = {"contacts": float(len(points)), "residual_rms_m": found.rms}
    if math.isfinite(foretold):
        figures |= {"foretold_rms_m": foretold, "foretold_worst_m": float(off.max(initial=0.0))}
    if found.rms > UNSUITED * sigma:
        why = (
            f"no superquadric contains it: contacts are {1e3 * found.rms:.3f} mm rms off the best "
            f"one, tapered and bent, where one standard deviation is {1e3 * sigma:.3f} mm"
        )
        return Findings(status="unsuited", reason=why, figures=figures)
    if not found.fitted or len(off) < FORETOLD // 2 or off.max() > _worst(setting):
        why = (
            f"{len(points)} contacts do not determine a superquadric: the last {len(off)} were off "
            f"the one before by up to {1e3 * float(off.max(initial=0.0)):.1f} mm"
        )
        return Findings(status="incomplete", reason=why, figures=figures)
    beyond, unmet = _beyond(found, points), _unmet(found, grasp.normals)
    if beyond > BEYOND or unmet:
        why = f"no contact says where it ends: {1e3 * beyond:.0f} mm of it lie beyond them all"
        return Findings(status="incomplete", reason=why, figures=figures)
    reason = (
        f"a superquadric goes through {len(points)} contacts within {1e3 * found.rms:.3f} mm, and "
        f"foretold the last {len(off)} within {1e3 * float(off.max()):.3f} mm"
    )
    mesh = found.shape().mesh(MESH_LEVEL)
    return Findings(status="done", reason=reason, shape=found, mesh=mesh, figures=figures)


def _beyond(found: FittedSuperquadric, points: Floats) -> float:
    """How far the solid lies beyond contacts (n, 3), not downwards, m: in the world, and its own.

    Corners lie beyond contacts in the world, along no axis of the solid: there half as much counts.
    """
    position, axes = Pose.from_array(found.pose)
    inner = (points - position) @ axes
    reached = np.stack([inner.max(axis=0), -inner.min(axis=0)])
    own = np.where(_downward(axes), 0.0, found.size - reached).max()
    vertices = found.shape().mesh(MESH_LEVEL).vertices
    above = vertices.max(axis=0) - points.max(axis=0)
    below = points.min(axis=0) - vertices.min(axis=0)
    return float(max(own, 0.5 * above.max(), 0.5 * below[:2].max()))


def _unmet(found: FittedSuperquadric, normals: Floats) -> int:
    """Sides of the solid, but that to the platform, that no contact's normal (n, 3) faces."""
    axes = Pose.from_array(found.pose).axes
    facing = normals @ axes
    met = np.stack([(facing > FACING).any(axis=0), (facing < -FACING).any(axis=0)])
    return int((~(met | _downward(axes))).sum())


def _downward(axes: Floats) -> Bools:
    """Which ends of three axes, as columns, lead to the platform, (2, 3): where no contact is."""
    return np.asarray(np.stack([axes[2], -axes[2]]) < DOWN)
