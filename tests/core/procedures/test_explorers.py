"""Procedures on solids that suit them, and on solids that they must refuse."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from palpate.core import shapes
from palpate.core.arrays import Floats
from palpate.core.geometry import compare_surfaces, is_closed, prepare_surface
from palpate.core.poses import Pose
from palpate.core.procedures import Findings

from . import hand
from .hand import CUP, FAR, VASE, block, drive, posed, prism, stacked, superquadric, turned, without

SLOW = pytest.mark.slow
BOTH_NOISES = pytest.mark.parametrize("noise", ["exact", "noise"])
UP = np.array([0.0, 0.0, 1.0])


def with_both_noises(names: Iterable[str], *quick: str) -> Any:
    """Cases of names and noises; all are slow except exact ones of the names in `quick`."""
    cases = [
        pytest.param(name, noise, marks=() if noise == "exact" and name in quick else SLOW)
        for name in names
        for noise in ("exact", "noise")
    ]
    return pytest.mark.parametrize(("name", "noise"), cases)


def distance(solid: Any, findings: Findings, level: int = 0) -> Any:
    """Distances between a solid and the recovered mesh."""
    meshes = solid.mesh(level), findings.mesh
    return compare_surfaces(*(prepare_surface(*mesh) for mesh in meshes))


def recovered(name: str, solid: Any, noise: str = "exact", fingers: int = 1) -> Findings:
    """Findings of a procedure that recovers a solid."""
    findings = drive(name, solid, noise, fingers=fingers).findings
    assert findings.status == "done", findings.reason
    return findings


def angle_between(axis: Floats, true: Any) -> float:
    """Angle between two lines [deg]."""
    return float(np.degrees(np.arcsin(min(np.linalg.norm(np.cross(axis, true)), 1.0))))


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
def test_planar_recovers_convex_polyhedron(name, noise):
    solid = POLYHEDRA[name]
    findings = recovered("planar", solid, noise)
    edges, true = findings.shape.polyhedron.edges, solid.edges
    assert len(edges.ends) == len(true.ends) and edges.vertices == true.vertices
    assert edges.euler == 2 and findings.mesh is not None and is_closed(findings.mesh.faces)
    assert findings.figures["faces"] == len(findings.shape.planes) == len(findings.shape.touches)
    assert distance(solid, findings).hausdorff < (5e-5 if noise == "exact" else 0.3e-3)


@BOTH_NOISES
def test_planar_block_is_as_exact_as_its_planes(noise):
    findings = drive("planar", block(), noise).findings
    normals = np.array([plane.normal for plane in findings.shape.planes])
    tilt = np.degrees(np.arccos(np.abs(normals).max(axis=1).clip(max=1.0)))
    assert tilt.max() < (1e-4 if noise == "exact" else 0.2)
    off = np.abs(np.abs(findings.shape.vertices - [0, 0, 0.025]) - [0.03, 0.022, 0.025])
    assert off.max() < (1e-7 if noise == "exact" else 0.3e-3)
    assert findings.figures["rim_gap_m"] < 1.2e-3 and "rounded" not in findings.reason
    by_face = zip(np.round(normals).tolist(), findings.shape.touches, strict=True)
    touches = {tuple(normal): count for normal, count in by_face}
    assert touches.pop((0.0, 0.0, -1.0)) == 0 and min(touches.values()) >= 5  # it stands on one


@BOTH_NOISES
def test_planar_reports_rounded_rim_and_keeps_edges(noise):
    solid = posed(superquadric((35, 25, 45), (0.1, 0.1)), 0.045)
    findings = recovered("planar", solid, noise)
    figures = findings.figures
    assert figures["faces"] == 6
    assert np.abs(np.abs(findings.shape.vertices[:, :2]) - [0.035, 0.025]).max() < 0.4e-3
    # Its edges lie 1.5 mm inside the faces' intersections, its corners 3.3 mm.
    assert 1.2e-3 < figures["rim_gap_m"] < 3.6e-3 and "cut or rounded by" in findings.reason
    assert 5e-3 < figures["farthest_untouched_m"] < 20e-3


EGG = shapes.DeformedSuperquadric(
    superquadric((30, 25, 45), (0.4, 0.8)), np.array([0.2, 0.1]), shapes.Bend(5.0, 0.0)
)
POSED_EGG = posed(EGG, 0.046)


@pytest.mark.parametrize("noise", ["exact", pytest.param("noise", marks=SLOW)])
def test_containment_recovers_tapered_bent_superquadric(noise):
    findings = recovered("containment", POSED_EGG, noise)
    assert 60 <= findings.figures["contacts"] <= 100
    size_error, exponent_error = (1e-5, 1e-3) if noise == "exact" else (0.5e-3, 0.06)
    assert np.sort(findings.shape.size) == pytest.approx([0.025, 0.03, 0.045], abs=size_error)
    assert findings.shape.exponents == pytest.approx([0.4, 0.8], abs=exponent_error)
    assert findings.shape.bend.curvature != 0.0 and findings.shape.taper.any()
    if noise == "noise":
        fewer = drive("containment", POSED_EGG, contacts=30).findings
        assert 30 <= fewer.figures["contacts"] < 60


CONTAINED = {
    "block": block(),
    "cone": turned([[0, 1], [80, 0.4]]),
    "can": posed(superquadric((25, 25, 45), (0.05, 1.0)), 0.045),
    "plate": block(0.06, 0.06, 0.008),  # its rim is too low to be touched
}


@with_both_noises(CONTAINED)
def test_containment_is_incomplete_or_accurate(name, noise):
    solid = CONTAINED[name]
    findings = drive("containment", solid, noise).findings
    if findings.status == "done":
        assert distance(solid, findings, 4).rms < 0.3e-3
        assert findings.mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=0.3e-3)
        assert findings.figures["foretold_worst_m"] <= 0.5e-3
    else:
        assert findings.status == "incomplete" and findings.mesh is None
        assert name == "plate" or "do not determine a superquadric" in findings.reason


CENTRED = turned([[-45, 1], [45, 1]], (25, 25))
REVOLVED = {
    "cylinder": (turned([[0, 1], [90, 1]], (25, 25)), 0.0),
    "cone": (turned([[0, 1], [80, 0.4]]), 0.0),
    "vase": (VASE, 0.0),
    "leaning": (posed(CENTRED, 0.055, 20.0), 20.0),
    "lying": (posed(CENTRED, 0.025, 90.0), 90.0),
}


@with_both_noises(REVOLVED, "cylinder")
def test_follower_recovers_surface_of_revolution_and_axis(name, noise):
    solid, degrees = REVOLVED[name]
    findings = recovered("follower", solid, noise, fingers=2)
    off = angle_between(findings.shape.axis, hand.rotation(degrees)[:, 2])
    assert findings.shape.kind == "revolution" and off < (0.3 if degrees else 0.2)
    if not degrees:
        assert findings.figures["residual_rms_m"] < (5e-5 if noise == "exact" else 1.5e-4)
    if noise == "exact" and name in ("cylinder", "cone"):
        assert distance(solid, findings, 5).rms < 5e-5


@SLOW
@BOTH_NOISES
def test_follower_takes_elliptic_axis_from_plane_end(noise):
    solid = turned([[0, 1], [80, 0.6]], (35, 25))
    findings = recovered("follower", solid, noise, fingers=2)
    assert findings.shape.kind == "linear"
    radii = findings.shape.radius(np.zeros(40), np.linspace(0.0, 2.0 * np.pi, 40))
    ratio = radii.max() / radii.min()
    assert angle_between(findings.shape.axis, UP) < 0.2
    assert ratio == pytest.approx(1.4, abs=0.01 if noise == "exact" else 0.08)


@SLOW
def test_follower_closes_round_end_accurately():
    solid = posed(superquadric((30, 30, 40), (1, 1)), 0.04)
    findings = recovered("follower", solid, fingers=2)
    top = findings.mesh.vertices[findings.mesh.vertices[:, 2] > 0.045]
    gauge = np.linalg.norm((top - [0, 0, 0.04]) / [0.03, 0.03, 0.04], axis=1)
    assert np.abs(gauge - 1.0).max() * 0.03 < 0.3e-3
    assert findings.figures["untouched_m"] > 5e-3 and "not touched" in findings.reason  # its foot


ROUND = turned([[0, 1], [80, 0.4]])
TILTED = hand.rotation(15.0)[:, 2]
CONES: dict[str, tuple[Any, Any, Any]] = {
    # solid, true axis from bottom to top, true apex [m]
    "round": (ROUND, UP, [0, 0, 0.4 / 3.0]),
    "elliptic": (turned([[0, 1], [80, 0.6]], (35, 25)), UP, [0, 0, 0.2]),
    "upside down": (turned([[0, 0.5], [80, 1]]), -UP, [0, 0, -0.08]),
    "pyramid": (prism(4, 0.04, 0.06, 0.4), UP, [0, 0, 0.1]),
    "six-sided": (prism(6, 0.04, 0.07, 0.5), UP, [0, 0, 0.14]),
    "leaning": (posed(ROUND, 0.01, 15.0), TILTED, 0.4 / 3.0 * TILTED + [0, 0, 0.01]),
}


@with_both_noises(CONES, "round", "elliptic", "upside down")
def test_fearing_recovers_axis_and_apex_of_cone(name, noise):
    solid, axis, apex = CONES[name]
    findings, touches = drive("fearing", solid, noise, fingers=3)
    assert findings.status == "done", findings.reason
    assert findings.mesh is None and touches < 18  # the section stays unknown
    tilt = np.degrees(np.arccos(min(float(findings.shape.orientation.axis @ axis), 1.0)))
    shift = np.linalg.norm(findings.shape.origin.point - apex)
    # A leaning cone is touched at fewer places of its side.
    max_tilt, max_shift = (0.3, 1e-3) if name == "leaning" else (0.1, 1e-4)
    figures = findings.figures
    assert tilt < (max_tilt if noise == "exact" else 3.0 * figures["axis_error_deg"])
    assert shift < (max_shift if noise == "exact" else 4.0 * figures["apex_error_m"])


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
def test_openings_classifies_and_measures_holes_and_cavities(name, noise):
    solid, kinds = HOLLOW[name]
    findings = recovered("openings", solid, noise)
    assert [opening.kind for opening in findings.shape.openings] == kinds, findings.reason
    if noise == "exact" and name == "cup":
        (cavity,) = findings.shape.openings
        assert cavity.axis == pytest.approx(UP, abs=0.05)
        assert np.abs(cavity.place[:2]).max() < 5e-3
        assert cavity.width == pytest.approx(0.056, abs=0.01)
        assert cavity.depth == pytest.approx(0.045, abs=0.006)
    if noise == "exact" and name == "pierced":
        (hole,) = findings.shape.openings
        assert abs(hole.axis[0]) > 0.95 and hole.depth == pytest.approx(0.076, abs=0.01)


SPHERE = posed(superquadric((35, 35, 35), (1, 1)), 0.035)
NOTCHED = 1e-3 * np.array([[-40, -40], [40, -40], [40, 0], [0, 0], [0, 40], [-40, 40]])
HEXAGON = [[np.cos(turn), np.sin(turn)] for turn in np.arange(6) * np.pi / 3]
TWO_CONES = stacked(HEXAGON, (0.0, 0.045, 0.08), (0.022, 0.038, 0.02))
BENT = shapes.DeformedSuperquadric(
    superquadric((20, 20, 50), (0.1, 1.0)), np.zeros(2), shapes.Bend(6.0, 0.0)
)
ROUNDED_BOX = posed(superquadric((35, 25, 45), (0.1, 0.1)), 0.05)
AMPHORA = [[0, 0.8], [20, 1], [45, 1.05], [70, 0.75], [85, 0.62], [100, 0.62]]
BORED = without(turned([[0, 1], [60, 1]]), turned([[-10, 1], [70, 1]], (5, 5)))
SLOPE = shapes.HalfSpace(np.array([0.3, 0.0, 1.0]) / np.hypot(0.3, 1.0), 0.05)
SLANTED = shapes.BooleanShape(shapes.Intersection([turned([[0, 1], [60, 1]]), SLOPE]))
NO_CONE = "no generalised cone fits: residuals in mm rms are revolution"


@pytest.mark.parametrize(("name", "solid", "fingers", "status", "words"), [
    ("planar", SPHERE, 1, "unsuited", "curved"),
    ("planar", posed(superquadric((30, 30, 45), (0.1, 1)), 0.045), 1, "unsuited",
     "radius of 30 mm"),
    ("planar", stacked(NOTCHED, (0.0, 0.05), (1, 1)), 1, "unsuited", "not convex"),
    ("planar", posed(block(), 0.03, 20.0), 1, "", ""),  # on its edge, the platform is no face
    ("planar", shapes.PosedShape(block(), FAR), 1, "incomplete", "nothing was touched"),
    pytest.param("containment", VASE, 1, "unsuited", "no superquadric contains it", marks=SLOW),
    pytest.param("containment", CUP, 1, "", "", marks=SLOW),  # hollow under the palm
    pytest.param(
        "containment", shapes.PosedShape(EGG, FAR), 1, "incomplete", "0 contacts", marks=SLOW
    ),
    pytest.param("follower", posed(BENT, 0.05), 2, "unsuited", NO_CONE, marks=SLOW),
    pytest.param("follower", ROUNDED_BOX, 2, "unsuited", NO_CONE, marks=SLOW),
    pytest.param("follower", CUP, 2, "unsuited", "it is hollow", marks=SLOW),
    pytest.param("follower", BORED, 2, "unsuited", "touch nothing", marks=SLOW),
    ("follower", SLANTED, 2, "unsuited", "its end leans by 17 degrees"),
    ("follower", REVOLVED["cylinder"][0], 1, "unsuited", "two fingers"),
    ("fearing", turned(AMPHORA, smooth=True), 3, "unsuited", "curved both ways"),
    ("fearing", SPHERE, 3, "unsuited", "curved both ways"),
    ("fearing", TWO_CONES, 3, "unsuited", "no cone has"),
    ("fearing", REVOLVED["cylinder"][0], 3, "unsuited", ""),
    pytest.param("fearing", prism(4, 0.04, 0.06), 3, "unsuited", "", marks=SLOW),
    ("fearing", ROUND, 2, "unsuited", ""),
])  # fmt: skip
def test_procedure_refuses_unsuited_object(name, solid, fingers, status, words):
    noise = "exact" if solid is SLANTED else "noise"  # under noise its end seems hollow
    findings, touches = drive(name, solid, noise, fingers=fingers)
    assert findings.status in ((status,) if status else ("unsuited", "incomplete"))
    assert words in findings.reason and findings.shape is None and findings.mesh is None
    if name == "fearing" and fingers == 3:
        reasons = ("apex", "no cone", "feature of a cone")
        assert any(reason in findings.reason for reason in reasons)
    if words == NO_CONE:
        assert findings.figures["residual_revolution_m"] > 3e-4
    if name == "containment" and solid is VASE:
        assert findings.figures["residual_rms_m"] > 3e-4
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
def test_unknown_procedure_or_setting_raises(name, settings, error, words):
    with pytest.raises(error, match=words):
        drive(name, block(), **settings)
