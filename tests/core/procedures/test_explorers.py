"""Procedures on solids that they serve, and on solids that they must refuse."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import compare_surfaces, is_closed, prepare_surface
from palpate.core.poses import Pose
from palpate.core.procedures import Findings

from .hand import (
    CUP,
    FAR,
    VASE,
    block,
    drive,
    posed,
    prism,
    stacked,
    superquadric,
    turned,
    without,
)

SLOW = pytest.mark.slow
BOTH_NOISES = pytest.mark.parametrize("noise", ["exact", "noise"])
UP = np.array([0.0, 0.0, 1.0])


def with_both_noises(names: Iterable[str], *quick: str) -> Any:
    """Cases of names and noises; slow but for those of a few names without noise."""
    cases = [
        pytest.param(name, noise, marks=() if noise == "exact" and name in quick else SLOW)
        for name in names
        for noise in ("exact", "noise")
    ]
    return pytest.mark.parametrize(("name", "noise"), cases)


def distance(solid: Any, found: Findings, level: int = 0) -> Any:
    """Distances between a solid and the mesh that was found."""
    assert found.mesh is not None
    return compare_surfaces(*(prepare_surface(*one) for one in (solid.mesh(level), found.mesh)))


def lean(axis: Floats, true: Any) -> float:
    """Angle between two lines [deg]."""
    return float(np.degrees(np.arcsin(min(np.linalg.norm(np.cross(axis, true)), 1.0))))


def leaning(degrees: float) -> Floats:
    """The z axis, turned as `posed` turns it."""
    turn = np.radians(degrees)
    axis = np.sin(turn) * np.array([0.3, -1.0, 0.0]) / np.hypot(1.0, 0.3)
    axis[2] = np.cos(turn)
    return axis


WEDGE = shapes.Polyhedron(
    1e-3 * np.array([[-35, -25, 0], [35, -25, 0], [35, 25, 0], [-35, 25, 0], [-35, -25, 50],
                     [-35, 25, 50]], float),
    [[3, 2, 1, 0], [0, 1, 4], [2, 3, 5], [1, 2, 5, 4], [3, 0, 4, 5]],
)  # fmt: skip
CUT_EDGE = 1e-3 * np.array([[-30, -22], [30, -22], [30, 14], [22, 22], [-30, 22]])
POLYHEDRA = {
    "block": block(),
    "wedge": WEDGE,
    "prism": prism(3, 0.035, 0.06),
    "six-sided prism": prism(6, 0.035, 0.06),
    "cut pyramid": prism(4, 0.04, 0.05, 0.6),
    "cut cone of five sides": prism(5, 0.04, 0.06, 0.3),
    "block with a cut edge": stacked(CUT_EDGE, (0.0, 0.05), (1, 1)),
}


@with_both_noises(POLYHEDRA, "wedge", "prism", "cut pyramid", "block with a cut edge")
def test_a_polyhedron_closes_where_its_planes_meet(name, noise):
    solid = POLYHEDRA[name]
    found = drive("planar", solid, noise).findings
    assert found.status == "done", found.reason
    edges, true = found.shape.polyhedron.edges, solid.edges
    assert len(edges.ends) == len(true.ends) and edges.vertices == true.vertices
    assert edges.euler == 2 and found.mesh is not None and is_closed(found.mesh.faces)
    assert found.figures["faces"] == len(found.shape.planes) == len(found.shape.touches)
    assert distance(solid, found).hausdorff < (5e-5 if noise == "exact" else 0.3e-3)


@BOTH_NOISES
def test_a_block_is_as_exact_as_its_planes(noise):
    found = drive("planar", block(), noise).findings
    normals = np.array([plane.normal for plane in found.shape.planes])
    tilt = np.degrees(np.arccos(np.abs(normals).max(axis=1).clip(max=1.0)))
    assert tilt.max() < (1e-4 if noise == "exact" else 0.2)
    off = np.abs(np.abs(found.shape.vertices - [0, 0, 0.025]) - [0.03, 0.022, 0.025])
    assert off.max() < (1e-7 if noise == "exact" else 0.3e-3)
    assert found.figures["rim_gap_m"] < 1.2e-3 and "rounded" not in found.reason
    by_face = zip(np.round(normals).tolist(), found.shape.touches, strict=True)
    touches = {tuple(normal): count for normal, count in by_face}
    assert touches.pop((0.0, 0.0, -1.0)) == 0 and min(touches.values()) >= 5  # it stands on one


@BOTH_NOISES
def test_a_rounded_rim_does_not_move_an_edge_and_is_reported(noise):
    solid = posed(superquadric((35, 25, 45), (0.1, 0.1)), 0.045)
    found = drive("planar", solid, noise).findings
    assert found.status == "done" and found.figures["faces"] == 6
    assert np.abs(np.abs(found.shape.vertices[:, :2]) - [0.035, 0.025]).max() < 0.4e-3
    # Its edges lie 1.5 mm inside the faces' intersections, its corners 3.3 mm.
    assert 1.2e-3 < found.figures["rim_gap_m"] < 3.6e-3 and "cut or rounded by" in found.reason
    assert 5e-3 < found.figures["farthest_untouched_m"] < 20e-3


EGG = shapes.DeformedSuperquadric(
    superquadric((30, 25, 45), (0.4, 0.8)), np.array([0.2, 0.1]), shapes.Bend(5.0, 0.0)
)
POSED_EGG = posed(EGG, 0.046)


@with_both_noises(["egg"], "egg")
def test_a_tapered_and_bent_superquadric_is_recovered(name, noise):
    found = drive("containment", POSED_EGG, noise).findings
    assert found.status == "done", found.reason
    assert 60 <= found.figures["contacts"] <= 100
    close, alike = (1e-5, 1e-3) if noise == "exact" else (0.5e-3, 0.06)
    assert np.sort(found.shape.size) == pytest.approx([0.025, 0.03, 0.045], abs=close)
    assert found.shape.exponents == pytest.approx([0.4, 0.8], abs=alike)
    assert found.shape.bend.curvature != 0.0 and found.shape.taper.any()
    if noise == "noise":
        fewer = drive("containment", POSED_EGG, contacts=30).findings
        assert 30 <= fewer.figures["contacts"] < 60


PLATE = block(0.06, 0.06, 0.008)  # its rim is too low to be touched
CONTAINED = {
    "block": block(),
    "cone": turned([[0, 1], [80, 0.4]]),
    "can": posed(superquadric((25, 25, 45), (0.05, 1.0)), 0.045),
    "plate": PLATE,
}


@with_both_noises(CONTAINED)
def test_what_no_contact_determines_is_not_made_up(name, noise):
    solid = CONTAINED[name]
    found = drive("containment", solid, noise).findings
    if found.status == "done":
        assert distance(solid, found, 4).rms < 0.3e-3
        assert found.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=0.3e-3)
        assert found.figures["foretold_worst_m"] <= 0.5e-3
    else:
        assert found.status == "incomplete" and found.mesh is None
        assert name == "plate" or "do not determine a superquadric" in found.reason


REVOLVED = {
    "cylinder": turned([[0, 1], [90, 1]], (25, 25)),
    "cone": turned([[0, 1], [80, 0.4]]),
    "vase": VASE,
}
CENTRED = turned([[-45, 1], [45, 1]], (25, 25))


@with_both_noises(REVOLVED, "cylinder")
def test_surfaces_of_revolution_are_found_with_their_axis(name, noise):
    found = drive("follower", REVOLVED[name], noise, fingers=2).findings
    assert found.status == "done", found.reason
    assert found.shape.kind == "revolution" and lean(found.shape.axis, UP) < 0.2
    assert found.figures["residual_rms_m"] < (5e-5 if noise == "exact" else 1.5e-4)
    if noise == "exact" and name != "vase":
        assert distance(REVOLVED[name], found, 5).rms < 5e-5


@with_both_noises(["leaning", "lying"])
def test_an_axis_that_leans_or_lies_is_found(name, noise):
    degrees, height = {"leaning": (20.0, 0.055), "lying": (90.0, 0.025)}[name]
    solid = posed(CENTRED, height, np.radians(degrees))
    found = drive("follower", solid, noise, fingers=2).findings
    assert found.status == "done", found.reason
    assert lean(found.shape.axis, leaning(degrees)) < 0.3


@SLOW
@BOTH_NOISES
def test_the_axis_of_an_elliptic_cone_comes_from_its_end(noise):
    solid = turned([[0, 1], [80, 0.6]], (35, 25))
    found = drive("follower", solid, noise, fingers=2).findings
    assert found.status == "done" and found.shape.kind == "linear", found.reason
    radii = found.shape.radius(np.zeros(40), np.linspace(0.0, 2.0 * np.pi, 40))
    ratio = radii.max() / radii.min()
    assert lean(found.shape.axis, UP) < 0.2
    assert ratio == pytest.approx(1.4, abs=0.01 if noise == "exact" else 0.08)


@SLOW
def test_a_round_end_is_closed_as_it_was_touched():
    solid = posed(superquadric((30, 30, 40), (1, 1)), 0.04)
    found = drive("follower", solid, fingers=2).findings
    assert found.status == "done" and found.mesh is not None
    top = found.mesh.vertices[found.mesh.vertices[:, 2] > 0.045]
    gauge = np.linalg.norm((top - [0, 0, 0.04]) / [0.03, 0.03, 0.04], axis=1)
    assert np.abs(gauge - 1.0).max() * 0.03 < 0.3e-3
    assert found.figures["untouched_m"] > 5e-3 and "not touched" in found.reason  # its foot


ROUND = turned([[0, 1], [80, 0.4]])
CONES: dict[str, tuple[Any, Any, Any]] = {
    # solid, true axis from bottom to top, true apex [m]
    "round": (ROUND, UP, [0, 0, 0.4 / 3.0]),
    "elliptic": (turned([[0, 1], [80, 0.6]], (35, 25)), UP, [0, 0, 0.2]),
    "upside down": (turned([[0, 0.5], [80, 1]]), -UP, [0, 0, -0.08]),
    "pyramid": (prism(4, 0.04, 0.06, 0.4), UP, [0, 0, 0.1]),
    "six-sided": (prism(6, 0.04, 0.07, 0.5), UP, [0, 0, 0.14]),
    "leaning": (
        posed(ROUND, 0.01, np.radians(15.0)),
        leaning(15.0),
        0.4 / 3.0 * leaning(15.0) + [0, 0, 0.01],
    ),
}


@with_both_noises(CONES, "round", "elliptic", "upside down")
def test_axis_and_apex_follow_from_what_three_fingers_touch(name, noise):
    solid, axis, apex = CONES[name]
    found, touches = drive("fearing", solid, noise, fingers=3)
    assert found.status == "done", found.reason
    assert found.mesh is None and touches < 18  # the section stays unknown
    tilt = np.degrees(np.arccos(min(float(found.shape.orientation.axis @ axis), 1.0)))
    off = np.linalg.norm(found.shape.origin.point - apex)
    # A cone that leans is touched at fewer places of its side.
    most = (0.3, 1e-3) if name == "leaning" else (0.1, 1e-4)
    figures = found.figures
    assert tilt < (most[0] if noise == "exact" else 3.0 * figures["axis_error_deg"])
    assert off < (most[1] if noise == "exact" else 4.0 * figures["apex_error_m"])


TUBE = without(turned([[0, 1], [60, 1]], (40, 40)), turned([[-10, 1], [70, 1]], (15, 15)))
DEEP_CUP = without(turned([[0, 1], [60, 1]], (40, 40)), turned([[15, 1], [70, 1]], (28, 28)))
ACROSS = shapes.PosedSolid(
    turned([[-60, 1], [60, 1]], (12, 12)),
    Pose.from_array(np.array([0.0, 0, 0.033, 0, np.sqrt(0.5), 0, np.sqrt(0.5)])),
)
HOLLOW = {
    "solid": (turned([[0, 1], [60, 1]], (40, 40)), []),
    "tube": (TUBE, ["hole"]),
    "cup": (DEEP_CUP, ["cavity"]),
    "pierced": (without(turned([[0, 1], [60, 1]], (40, 40)), ACROSS), ["hole"]),
}


@with_both_noises(HOLLOW)
def test_holes_and_cavities_are_told_apart_and_measured(name, noise):
    solid, kinds = HOLLOW[name]
    found = drive("openings", solid, noise).findings
    assert found.status == "done"
    assert [one.kind for one in found.shape.openings] == kinds, found.reason
    if noise == "exact" and name == "cup":
        (cavity,) = found.shape.openings
        assert cavity.axis == pytest.approx(UP, abs=0.05)
        assert np.abs(cavity.place[:2]).max() < 5e-3
        assert cavity.width == pytest.approx(0.056, abs=0.01)
        assert cavity.depth == pytest.approx(0.045, abs=0.006)
    if noise == "exact" and name == "pierced":
        (hole,) = found.shape.openings
        assert abs(hole.axis[0]) > 0.95 and hole.depth == pytest.approx(0.076, abs=0.01)


SPHERE = posed(superquadric((35, 35, 35), (1, 1)), 0.035)
NOTCHED = 1e-3 * np.array([[-40, -40], [40, -40], [40, 0], [0, 0], [0, 40], [-40, 40]])
HEXAGON = [[np.cos(turn), np.sin(turn)] for turn in np.arange(6) * np.pi / 3]
TWO_CONES = stacked(HEXAGON, (0.0, 0.045, 0.08), (0.022, 0.038, 0.02))
BENT = shapes.DeformedSuperquadric(
    superquadric((20, 20, 50), (0.1, 1.0)), np.zeros(2), shapes.Bend(6.0, 0.0)
)
AMPHORA = [[0, 0.8], [20, 1], [45, 1.05], [70, 0.75], [85, 0.62], [100, 0.62]]
BORED = without(turned([[0, 1], [60, 1]]), turned([[-10, 1], [70, 1]], (5, 5)))
SLOPE = shapes.HalfSpace(np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0), 0.05)
SLANTED = shapes.BooleanShape(shapes.Intersection([turned([[0, 1], [60, 1]]), SLOPE]))
NO_CONE = "no generalised cone fits: residuals in mm rms are revolution"


@pytest.mark.parametrize(("name", "solid", "fingers", "status", "words"), [
    # procedure, solid, fingers, status, words of the reason
    ("planar", SPHERE, 1, "unsuited", "curved"),
    ("planar", posed(superquadric((30, 30, 45), (0.1, 1)), 0.045), 1, "unsuited",
     "radius of 30 mm"),
    ("planar", stacked(NOTCHED, (0.0, 0.05), (1, 1)), 1, "unsuited", "not convex"),
    ("planar", posed(block(), 0.03, 0.35), 1, "", ""),  # on its edge: the platform is no face
    ("planar", shapes.PosedShape(block(), FAR), 1, "incomplete", "nothing was touched"),
    pytest.param("containment", VASE, 1, "unsuited", "no superquadric contains it", marks=SLOW),
    pytest.param("containment", CUP, 1, "", "", marks=SLOW),  # hollow under the palm
    pytest.param(
        "containment", shapes.PosedShape(EGG, FAR), 1, "incomplete", "0 contacts", marks=SLOW
    ),
    pytest.param("follower", posed(BENT, 0.05), 2, "unsuited", NO_CONE, marks=SLOW),
    pytest.param(
        "follower",
        posed(superquadric((35, 25, 45), (0.1, 0.1)), 0.05),
        2,
        "unsuited",
        NO_CONE,
        marks=SLOW,
    ),
    pytest.param("follower", CUP, 2, "unsuited", "it is hollow", marks=SLOW),
    pytest.param("follower", BORED, 2, "unsuited", "touch nothing", marks=SLOW),
    ("follower", SLANTED, 2, "unsuited", "its end leans by 17 degrees"),
    ("follower", REVOLVED["cylinder"], 1, "unsuited", "two fingers"),
    ("fearing", turned(AMPHORA, smooth=True), 3, "unsuited", "curved both ways"),
    ("fearing", SPHERE, 3, "unsuited", "curved both ways"),
    ("fearing", TWO_CONES, 3, "unsuited", "no cone has"),
    ("fearing", REVOLVED["cylinder"], 3, "unsuited", ""),
    pytest.param("fearing", prism(4, 0.04, 0.06), 3, "unsuited", "", marks=SLOW),
    ("fearing", ROUND, 2, "unsuited", ""),
])  # fmt: skip
def test_what_a_procedure_cannot_serve_is_refused(name, solid, fingers, status, words):
    noise = "exact" if solid is SLANTED else "noise"  # under noise its end seems hollow
    found, touches = drive(name, solid, noise, fingers=fingers)
    assert found.status == status or (not status and found.status in ("unsuited", "incomplete"))
    assert words in found.reason and found.shape is None and found.mesh is None
    if name == "fearing" and fingers == 3:
        reasons = ("apex", "no cone", "feature of a cone")
        assert any(reason in found.reason for reason in reasons)
    if words == NO_CONE:
        assert found.figures["residual_revolution_m"] > 3e-4
    if name == "containment" and solid is VASE:
        assert found.figures["residual_rms_m"] > 3e-4
    if words == "two fingers" or (name, fingers) == ("fearing", 2):
        assert touches == 0


@pytest.mark.parametrize(("name", "settings", "error", "words"), [
    ("containment", {"contacts": 29}, ValueError, "contacts must be from 30 to 100, got 29"),
    ("containment", {"contacts": 101}, ValueError, "contacts must be from 30 to 100, got 101"),
    ("openings", {"pitch": 1.5}, ValueError, r"pitch must be from 0.3 to 1, got 1.5"),
    ("planer", {}, LookupError, "no procedure 'planer'; there are containment, planar"),
    ("planar", {"steps": 3}, ValueError, "'planar' has no setting 'steps'; it has none"),
    ("openings", {"step": 3}, ValueError, "'openings' has no setting 'step'; it has pitch"),
    ("no_such_module:explore", {}, ValueError, "cannot be imported"),
    ("math:pi", {}, ValueError, "is no function"),
])  # fmt: skip
def test_unknown_procedures_and_wrong_settings_are_refused(name, settings, error, words):
    with pytest.raises(error, match=words):
        drive(name, block(), **settings)
