"""Grasping by Containment: a hand that closes on the object, and the superquadric it contains.

Allen's first exploratory procedure (Fung, 1999, 1.4.3.2): 30 to 100 contacts from several poses of
the hand, through which Solina and Bajcsy's superquadric is fitted, tapered and bent. The text's
hand takes poses that its user chose; here each closing is where it is expected to tell most, and
more follow where the fit is left in doubt.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.explore.grasp import Hand, brought_near, next_pose, search_places, search_pose
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

FEWEST, MOST = 30, 100  # Contacts, as the text has them
CONTACTS = 60  # As many as tell taper and bend
MORE = 20  # Contacts that are added where the fit is in doubt
MOST_CLOSINGS = 60  # Once something was met
OPENING = 0.8  # Of the reach
MESH_LEVEL = 4
TOLD = ("one-sided", "loose")  # Doubts that are told with the result, and do not refute it


def containment(setting: TouchSetting, contacts: int = CONTACTS) -> Exploration:
    """Close the hand until there are so many contacts, and fit a tapered, bent superquadric.

    `contacts`: 30 to 100; where these leave the fit in doubt, there are up to 100. Findings: the
    recovered superquadric, or ``unsuited`` where contacts are off it by more than three standard
    deviations. Raises ValueError for another number.
    """
    if not FEWEST <= contacts <= MOST:
        raise ValueError(f"contacts must be from {FEWEST} to {MOST}, got {contacts}")
    grasp, wanted = _Grasp(setting), contacts
    while True:
        yield from grasp.until(wanted)
        if len(grasp.points) < FEWEST:
            why = f"the hand made {len(grasp.points)} contacts within reach, {FEWEST} are needed"
            return Findings(status="incomplete", reason=why)
        findings = _fitted(setting, grasp.points)
        wanted += MORE
        if findings.status != "incomplete" or wanted > MOST or grasp.closings >= MOST_CLOSINGS:
            return findings


class _Grasp:
    """What the hand has met so far."""

    def __init__(self, setting: TouchSetting) -> None:
        self.setting = setting
        self.hand = Hand(opening=OPENING * setting.reach, reach=OPENING * setting.reach)
        self.points, self.normals = np.zeros((0, 3)), np.zeros((0, 3))
        self.searched = self.closings = 0

    def until(self, wanted: int) -> Generator[Move, Met, None]:
        """Close the hand until there are so many contacts, or it finds no more."""
        while len(self.points) < wanted and self.closings < MOST_CLOSINGS:
            move = self._next()
            if move is None:
                return
            met = yield from close(move)
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


def _fitted(setting: TouchSetting, points: Floats) -> Findings:
    """The superquadric, unless the contacts refute it."""
    sigma = setting.sigma
    found = fit_coarse(points, sigma)
    figures = {
        "contacts": float(len(points)),
        "residual_rms_m": found.rms,
        "uncovered_share": found.uncovered,
        "looseness_m": found.looseness,
    }
    if found.rms > UNSUITED * sigma:
        why = (
            f"no superquadric contains it: contacts are {1e3 * found.rms:.3f} mm rms off the best "
            f"one, tapered and bent, where one standard deviation is {1e3 * sigma:.3f} mm"
        )
        return Findings(status="unsuited", reason=why, figures=figures)
    doubts = [one for one in found.warnings if one not in TOLD]
    if doubts:
        why = f"{len(points)} contacts do not determine a superquadric: it is {', '.join(doubts)}"
        return Findings(status="incomplete", reason=why, figures=figures)
    reason = f"a superquadric goes through {len(points)} contacts within {1e3 * found.rms:.3f} mm"
    if found.warnings:
        reason += f"; it is {', '.join(found.warnings)}"
    mesh = found.shape().mesh(MESH_LEVEL)
    return Findings(status="done", reason=reason, shape=found, mesh=mesh, figures=figures)
