"""Shapes, pads and fingers that the tests of core share."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from palpate.core.explore.tracing.contour_path import TouchCommand, arc_in_slice
from palpate.core.explore.tracing.contour_trace import Trace, after_touch, next_command
from palpate.core.rebuild.contours.contacts import contact_points_of
from palpate.core.shapes.polyhedra import Polyhedron
from palpate.core.shapes.protocol import Shape
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.curvature import fit_patch
from palpate.core.touch.pad import Pad, guarded_move

CONTACT = 0.05e-3
BACK_OFF = 14e-3
ACROSS = np.array([0.0, 1.0, 0.0])


@dataclass
class Finger:
    """Pad, filterless sensing and tracer, as plain calls."""

    shape: Shape
    pad: Pad
    contacts: list = field(default_factory=list)

    def press(self, start, reach, depth, height):
        """One touch; what it measured is kept."""
        end = guarded_move(self.shape, self.pad, start, reach, depth)
        if end.outcome not in ("hit", "bottomed"):
            return None
        touched = end.compression > CONTACT
        surface = self.pad.surface(end.compression, touched)
        jet = fit_patch(self.pad, surface, touched, ACROSS, 0.0).jet
        self.contacts.append(contact_points_of(self.pad, end.pose, surface, touched, jet))
        return arc_in_slice(self.pad, end.pose, surface, touched, jet, height)

    def answer(self, aim, height):
        """One touch of a contour, from farther away if it would start inside."""
        start = guarded_move(self.shape, self.pad, aim.start(height), aim.travel, aim.posture.depth)
        if start.outcome == "inside":
            aim = aim._replace(standoff=aim.standoff + BACK_OFF)
        return self.press(aim.start(height), aim.travel, aim.posture.depth, height)

    def contour(self, wanted):
        """A contour, to its end."""
        trace = Trace(wanted)
        while True:
            trace, found = next_command(self.pad, trace)
            if not isinstance(found, TouchCommand):
                return trace, found
            assert trace.touches < wanted.most_touches
            trace = after_touch(trace, self.answer(found, wanted.height))


@pytest.fixture
def finger():
    return Finger


@pytest.fixture
def flat():
    return Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)


@pytest.fixture
def domed(flat):
    return Pad(flat.rows, flat.cols, flat.pitch, flat.thickness, 1 / 0.015, flat.saturation)


@pytest.fixture
def ball():
    """A ball of 60 mm about the origin."""
    return Superquadric(np.full(3, 0.03), np.ones(2))


@pytest.fixture
def box():
    return Superquadric(np.array([0.03, 0.02, 0.04]), np.array([0.1, 0.1]))


@pytest.fixture
def cylinder():
    return Superquadric(np.array([0.025, 0.025, 0.04]), np.array([0.1, 1.0]))


@pytest.fixture
def block():
    """A block of 60 by 44 by 50 mm about the origin: plane faces, sharp edges."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return Polyhedron(corners * [0.03, 0.022, 0.025], faces)


@pytest.fixture
def signed_volume():
    """Volume of a closed mesh; negative if it is turned inside out."""

    def volume(mesh):
        a, b, c = mesh.vertices[mesh.faces].transpose(1, 0, 2)
        return float(np.einsum("ni,ni->", a, np.cross(b, c))) / 6.0

    return volume


@pytest.fixture
def is_closed():
    """Whether every edge is met once each way and the surface is a topological sphere."""

    def closed(mesh):
        edges = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        there = {tuple(edge) for edge in edges.tolist()}
        back = {(b, a) for a, b in there}
        euler = len(mesh.vertices) - len(edges) // 2 + len(mesh.faces)
        used = len(np.unique(mesh.faces)) == len(mesh.vertices)
        return len(there) == len(edges) and there == back and euler == 2 and used

    return closed


@pytest.fixture
def rotations():
    """Random rotation matrices (n, 3, 3) of a fixed seed."""

    def draw(count):
        matrices = np.linalg.qr(np.random.default_rng(5).normal(size=(count, 3, 3)))[0]
        matrices[:, :, 0] *= np.linalg.det(matrices)[:, None]
        return np.asarray(matrices)

    return draw
