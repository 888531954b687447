"""Laws of free-form deformation: motion, derivatives, normals, meshes, pulled points, folds."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.geometry import is_closed, signed_volume
from palpate.core.splines import (
    Lattice,
    LatticeLayer,
    Parallelepiped,
    SplineVolume,
    box_lattice,
    clamped_basis,
    fold_report,
    folded_share,
    layered_lattice,
    pull_points,
)

LOW, EXTENT, COUNTS = np.array([-0.1, 0.2, 0.3]), np.array([0.5, 0.25, 2.0]), (6, 4, 5)
EDGES = np.array([[0.5, 0.1, 0.0], [-0.1, 0.25, 0.0], [0.3, 0.0, 2.0]])
RNG = np.random.default_rng(1)
NOISE = RNG.normal(size=(*COUNTS, 3))
WEIGHTS = RNG.uniform(0.5, 2.0, COUNTS)
INSIDE = np.random.default_rng(3).uniform(0.05, 0.9, (40, 3))
POINTS = LOW + EXTENT * np.random.default_rng(0).random((60, 3))
PLAIN = box_lattice(LOW, EXTENT, COUNTS)
BENT = PLAIN.with_control(PLAIN.control + 0.05 * EXTENT * NOISE)


FRAME, SKEW = Parallelepiped(LOW, EDGES), (clamped_basis(6), clamped_basis(4), clamped_basis(5, 2))
SHEARED = FRAME.greville_control(SKEW) + 0.02 * NOISE
BEFORE = PLAIN.control.copy()
BEFORE[..., 0] *= 1.0 + 0.3 * BEFORE[..., 2]
LATTICES = {
    "bent": BENT,
    "skewed": Lattice(SplineVolume(SHEARED, SKEW, WEIGHTS), FRAME),  # over a parallelepiped
    # Over an undeformed lattice that is no parallelepiped, and folds nowhere.
    "wedge": Lattice(BENT.volume, SplineVolume(BEFORE, PLAIN.volume.bases)),
}


def inside(lattice: Lattice) -> Floats:
    before = lattice.undeformed
    return before.points(INSIDE) if isinstance(before, Parallelepiped) else before.at(INSIDE)


@pytest.mark.parametrize(
    ("counts", "degree"), [(COUNTS, 3), ((2, 2, 2), 1), ((3, 4, 6), 2), ((5, 5, 5), 4)]
)
def test_undeformed_lattices_move_nothing(counts: tuple[int, int, int], degree: int):
    lattice = box_lattice(LOW, EXTENT, counts, degree)
    assert np.allclose(lattice.deform(POINTS), POINTS, rtol=0, atol=2e-15)
    assert np.allclose(lattice.jacobian_determinant(POINTS), 1.0, rtol=0, atol=2e-14)
    ends = [(0, 0, 0), (-1, 0, 0), (0, -1, 0), (0, 0, -1)]
    steps = np.vstack([np.zeros(3), np.diag(EXTENT)])
    assert [lattice.control[end] for end in ends] == pytest.approx(LOW + steps)


@pytest.mark.parametrize("lattice", LATTICES.values(), ids=LATTICES)
def test_jacobians_and_normals_are_those_of_finite_differences(lattice: Lattice):
    points, step = inside(lattice), 1e-6
    columns = [
        (lattice.deform(points + step * axis) - lattice.deform(points - step * axis)) / (2 * step)
        for axis in np.eye(3)
    ]
    wanted = np.stack(columns, axis=-1)
    moved, slopes = lattice.deform_with_jacobian(points)
    assert np.allclose(slopes, wanted, rtol=0, atol=1e-5)
    assert np.array_equal(lattice.jacobian(points), slopes)
    assert np.allclose(moved, lattice.deform(points), rtol=0, atol=1e-15)
    determinant = lattice.jacobian_determinant(points)
    assert np.allclose(determinant, np.linalg.det(wanted), rtol=1e-4, atol=1e-5)
    assert np.ptp(determinant) > 0.05
    # A normal follows the inverse transpose; outwards stays outwards, also in a mirror.
    normals = np.random.default_rng(7).normal(size=(40, 3))
    for hand in (1.0, -1.0):
        turned = lattice.with_control(lattice.control * [1, 1, hand])
        slopes = turned.jacobian(points)
        limit = np.linalg.solve(slopes.transpose(0, 2, 1), normals[:, :, None])[:, :, 0]
        limit /= np.linalg.norm(limit, axis=1, keepdims=True)
        assert np.allclose(turned.deform_normals(points, normals), limit, rtol=0, atol=1e-12)


def test_local_parameters_are_undone_by_the_undeformed_lattice():
    for lattice in LATTICES.values():
        assert np.allclose(lattice.local(inside(lattice)), INSIDE, rtol=0, atol=1e-9)
        moved = lattice.deform(inside(lattice))
        assert np.allclose(moved, lattice.volume.at(INSIDE), rtol=0, atol=1e-9)
    even = SplineVolume(FRAME.even_control(COUNTS), PLAIN.volume.bases)
    points = FRAME.points(INSIDE)
    assert np.allclose(Lattice(even, even).deform(points), points, rtol=0, atol=1e-12)
    far = box_lattice(LOW + 1e4, EXTENT, COUNTS)  # a point outside by rounding is on the face
    beyond = np.array([np.nextafter(far.control[-1, -1, -1], np.inf)])
    assert np.array_equal(far.local(beyond), [[1.0, 1.0, 1.0]])


def test_change_on_a_grid_is_the_jacobian_determinant():
    axes = np.array([0.0, 0.4, 1.0]), np.array([0.2, 0.9]), np.array([0.5])
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    for lattice in (LATTICES["bent"], LATTICES["skewed"]):
        wanted = lattice.jacobian_determinant(lattice.undeformed.points(grid))
        assert np.allclose(lattice.change_on_grid(*axes), wanted.reshape(3, 2, 1), rtol=1e-11)
    # Without a parallelepiped the unit is the mean of the undeformed lattice.
    before, fine = LATTICES["wedge"].undeformed, (np.arange(12) + 0.5) / 12
    for factor in (1.0, 2.0):
        wider = Lattice(SplineVolume(factor * before.control, before.bases), before)
        assert wider.change_on_grid(fine, fine, fine).mean() == pytest.approx(factor**3)
    flat = SplineVolume(PLAIN.control * [1, 1, 0], PLAIN.volume.bases)
    assert not Lattice(flat, flat).change_on_grid(*np.full((3, 2), 0.3)).any()


@pytest.mark.parametrize("scale", [1e-110, 1e-60, 1.0, 1e60])
def test_normals_of_squeezed_lattices_are_limits(scale: float):
    box = box_lattice(np.zeros(3), np.full(3, scale), (4, 4, 4))
    points = np.full((4, 3), 0.4 * scale)
    normals = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -2.0, 0.0]])
    for squeeze in ([1, 1, 0], [1, 0, 0], [0, 0, 0]):
        squeezed = box.with_control(box.control * squeeze)
        result = squeezed.deform_normals(points, normals)
        assert np.allclose(np.linalg.norm(result, axis=1), 1.0, rtol=0, atol=1e-14)
    flat = box.with_control(box.control * [1, 1, 0]).deform_normals(points, normals)
    assert np.allclose(flat[1:3], [0.0, 0.0, 1.0], rtol=0, atol=1e-8)


@pytest.mark.parametrize("scale", [1e-110, 1e-60, 1.0, 1e110])
def test_mirrored_mesh_keeps_its_outside(scale: float):
    vertices = scale * np.vstack([np.zeros(3), np.eye(3)])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]], np.int32)
    box = box_lattice(np.zeros(3), np.full(3, scale), (4, 4, 4))
    for by, order in (([2, 1, 1], faces), ([1, 1, -2], faces[:, ::-1])):
        moved, result = box.with_control(box.control * by).deform_mesh(vertices, faces)
        assert np.array_equal(result, order) and is_closed(result)
        assert signed_volume((moved / scale)[result]) == pytest.approx(2.0 / 6.0)
    assert box.deform_mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))[1].shape == (0, 3)


def test_weights_stay_unless_others_are_given():
    weighted = LATTICES["skewed"]
    again = weighted.with_control(weighted.control).volume.weights
    assert np.array_equal(again, WEIGHTS / WEIGHTS.max())
    other = weighted.with_control(weighted.control, np.ones(COUNTS)).volume.weights
    assert np.array_equal(other, np.ones(COUNTS))


BOX = np.array([[-0.03, -0.02, -0.05], [0.03, 0.02, 0.07]])


def test_layers_scale_turn_then_shift():
    points = BOX[0] + (BOX[1] - BOX[0]) * np.random.default_rng(0).random((50, 3))
    still = layered_lattice(BOX, [LatticeLayer()] * 5)
    assert still.control.shape == (4, 4, 5, 3)
    assert np.allclose(still.deform(points), points, rtol=0, atol=1e-16)
    moved = layered_lattice(BOX, [LatticeLayer(1.5, math.pi / 2, (0.01, 0.02))] * 4).deform(points)
    wanted = np.column_stack([-1.5 * points[:, 1] + 0.01, 1.5 * points[:, 0] + 0.02, points[:, 2]])
    assert np.allclose(moved, wanted, rtol=0, atol=1e-16)
    widened = layered_lattice(BOX, [LatticeLayer()] * 3 + [LatticeLayer(2.0)])  # at the top
    assert widened.deform(BOX) == pytest.approx(np.array([BOX[0], [0.06, 0.04, 0.07]]))


def test_folded_share_is_what_is_turned_inside_out():
    still = layered_lattice(BOX, [LatticeLayer()] * 4)
    turned = [LatticeLayer(), LatticeLayer(turn=3.0), LatticeLayer(turn=-3.0), LatticeLayer()]
    twisted = layered_lattice(BOX, turned)
    across, along = np.linspace(0, 1, 9), np.linspace(0, 1, 65)
    share = (twisted.change_on_grid(across, across, along) <= 0.0).mean()
    assert 0.0 < folded_share(twisted) == pytest.approx(share, abs=0.1)
    assert folded_share(still) == 0.0
    assert folded_share(still.with_control(still.control[:, :, ::-1])) == 1.0
    assert folded_share(layered_lattice(BOX, [LatticeLayer(0.05)] * 4)) == 1.0


@pytest.mark.parametrize("lattice", [PLAIN, LATTICES["skewed"]], ids=["plain", "weighted"])
@pytest.mark.parametrize("count", [1, 2, 12])
def test_pulled_points_reach_targets_by_the_least_change(lattice: Lattice, count: int):
    points = lattice.undeformed.points(INSIDE[:count])
    targets = points + 0.1 * np.random.default_rng(count).normal(size=(count, 3))
    pulled = pull_points(lattice, points, targets)
    assert np.allclose(pulled.lattice.deform(points), targets, rtol=0, atol=1e-10)
    assert pulled.residual.max() < 1e-10 and pulled.rank == count
    shares = lattice.volume.shares(lattice.local(points)).toarray()
    assert pulled.condition == pytest.approx(np.linalg.cond(shares))
    wanted = np.linalg.pinv(shares) @ (targets - lattice.deform(points))
    change = (pulled.lattice.control - lattice.control).reshape(-1, 3)
    assert np.allclose(change, wanted, rtol=0, atol=1e-12)
    again = pull_points(pulled.lattice, points, targets).lattice
    assert np.allclose(again.control, pulled.lattice.control, rtol=0, atol=1e-13)


def test_contradictory_pulls_meet_in_the_middle():
    points = np.repeat(POINTS[:1], 2, axis=0)
    pulled = pull_points(PLAIN, points, points + [[0, 0, 0.2], [0, 0, -0.1]])
    assert pulled.rank == 1
    assert np.allclose(pulled.residual, 0.15, rtol=0, atol=1e-12)
    assert np.allclose(pulled.lattice.deform(points[:1]), points[:1] + [0, 0, 0.05], atol=1e-12)
    many = LOW + EXTENT * np.random.default_rng(1).random((400, 3))
    targets = many + 0.05 * np.sin(9 * many)
    pulled = pull_points(PLAIN, many, targets)
    assert pulled.rank <= PLAIN.control[..., 0].size and pulled.residual.max() > 1e-6
    shares = PLAIN.volume.shares(PLAIN.local(many)).toarray()
    left = pulled.lattice.deform(many) - targets
    assert np.abs(shares.T @ left).max() < 1e-10  # control points can do nothing more
    none = pull_points(PLAIN, np.zeros((0, 3)), np.zeros((0, 3)))
    assert none.lattice is PLAIN and (none.rank, none.condition, len(none.residual)) == (0, 1.0, 0)


def disturbed(amount: float, seed: int, degree: int = 3, weighted: bool = False) -> Lattice:
    """Each control point moves by about that fraction of the distance to its neighbours."""
    counts = (degree + 2, degree + 1, degree + 3)
    plain, rng = box_lattice(LOW, EXTENT, counts, degree), np.random.default_rng(seed)
    noise = amount * EXTENT / (np.array(counts) - 1) * rng.normal(size=plain.control.shape)
    weights = rng.uniform(0.5, 2.0, counts) if weighted else None
    return plain.with_control(plain.control + noise, weights)


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize(("seed", "degree"), [(0, 1), (1, 2), (2, 3), (3, 3), (4, 3)])
def test_fold_verdicts_agree_with_samples(seed: int, degree: int, weighted: bool):
    # Of this noise the amount at which the first fold appears, by bisection over samples.
    low, high, axes = 0.0, 2.0, [np.linspace(0.0, 1.0, count) for count in (15, 16, 17)]
    for _ in range(14):
        middle = 0.5 * (low + high)
        folds = disturbed(middle, seed, degree, weighted).change_on_grid(*axes).min() < 0.0
        low, high = (low, middle) if folds else (middle, high)
    for share, verdict in ((0.9, "sound"), (1.03, "folded"), (2.5, "folded")):
        lattice = disturbed(share * high, seed, degree, weighted)
        report = fold_report(lattice)
        assert report.verdict == verdict
        there = lattice.change_on_grid(*report.where[:, None])[0, 0, 0]
        assert there == pytest.approx(report.least, rel=1e-9, abs=1e-12)
        assert (report.least < 0.0) == (verdict == "folded")
        middles = (np.arange(25) + 0.5) / 25
        samples = lattice.change_on_grid(middles, middles, middles)
        assert report.share == (samples <= 0.0).mean()
        assert report.least <= samples.min()


def test_fold_reports_of_known_lattices_are_exact():
    plain = box_lattice(LOW, EXTENT, (5, 4, 6))
    report = fold_report(plain)
    assert (report.verdict, report.share) == ("sound", 0.0)
    assert report.least == pytest.approx(1.0)
    mirrored = fold_report(plain.with_control(plain.control[::-1]))
    assert (mirrored.verdict, mirrored.share) == ("folded", 1.0)
    assert mirrored.least == pytest.approx(-1.0)
    left_handed = SplineVolume(plain.control * [-1, 1, 1], plain.volume.bases)
    assert fold_report(Lattice(left_handed, left_handed)).verdict == "sound"
    assert fold_report(Lattice(plain.volume, left_handed)).verdict == "folded"
    control = plain.control.copy()
    control[0, 0, 0] += 1.2 * (control[1, 0, 0] - control[0, 0, 0])  # past its neighbour
    hidden = fold_report(plain.with_control(control))
    assert hidden.verdict == "folded" and hidden.where.tolist() == [0.0, 0.0, 0.0]
    assert hidden.least < 0.0 and hidden.share < 0.001
    control = plain.control.copy()
    control[:, :, 0] = control[:, :, 1]  # the slope along u vanishes there
    flat = fold_report(plain.with_control(control))
    assert flat.verdict == "undecided" and flat.least == pytest.approx(0.0, abs=1e-12)
    # Of degree 6 rounding hides the sign: nothing is claimed.
    high = box_lattice(np.zeros(3), np.ones(3), (7, 7, 7), 6)
    assert fold_report(high).verdict == "undecided"
    assert fold_report(high).least == pytest.approx(1.0)
    assert fold_report(high.with_control(high.control[::-1])).verdict == "undecided"


@pytest.mark.parametrize("scale", [1e-150, 1e-3, 1e150])
@pytest.mark.parametrize("amount", [0.05, 0.3])
def test_unit_changes_no_fold_report(scale: float, amount: float):
    here, still = disturbed(amount, 0), disturbed(0.0, 0)
    plain = box_lattice(np.zeros(3), scale * EXTENT, here.control.shape[:3])
    wanted = fold_report(here)
    moved = plain.with_control(plain.control + scale * (here.control - still.control))
    for undeformed in (plain.undeformed, plain.volume):
        result = fold_report(Lattice(moved.volume, undeformed))
        assert (result.verdict, result.share) == (wanted.verdict, wanted.share)
        assert result.least == pytest.approx(wanted.least, rel=1e-9)


def test_folded_share_is_that_of_the_points_given():
    control = PLAIN.control.copy()
    control[..., 2] = np.abs(control[..., 2] - 1.3)  # the lower half turned over the upper
    folded = PLAIN.with_control(control)
    below, above = (LOW + EXTENT * np.array([[0.5, 0.5, u]]) for u in (0.1, 0.9))
    shares = [
        fold_report(folded, points).share
        for points in (below, above, np.concatenate([below, above, above]), np.zeros((0, 3)))
    ]
    assert shares == pytest.approx([1.0, 0.0, 1 / 3, 0.0])
    assert fold_report(folded, above).verdict == "folded"


CUBE = box_lattice(np.zeros(3), np.ones(3), (4, 4, 4))
ONE = np.full((1, 3), 0.5)
OUTSIDE = np.concatenate([POINTS[:3], LOW + EXTENT * np.array([[1.5, 0.5, 0.5], [0.5, -1, 0]])])


@pytest.mark.parametrize(("call", "words"), [
    (lambda: BENT.deform(OUTSIDE), r"2 of 5 .* worst \(0.15, -0.05, 0.3\) m by 1 of an edge"),
    (lambda: LATTICES["wedge"].deform(3 * ONE), r"1 of 1 .* worst \(1.5, 1.5, 1.5\) m by 1.\d+ m"),
    (lambda: BENT.deform(np.full((1, 3), math.nan)), "points must be finite"),
    (lambda: BENT.deform(np.zeros(3)), r"points must have shape \(any, 3\)"),
    (lambda: CUBE.deform_normals(ONE, np.zeros((1, 3))), "normals must have a direction, got zero"),
    (lambda: CUBE.deform_normals(ONE, np.zeros((2, 3))), r"normals must have shape \(1, 3\)"),
    (lambda: CUBE.deform_normals(ONE, np.full((1, 3), math.inf)), "normals must be finite"),
    (lambda: CUBE.deform_mesh(np.eye(3), np.array([[0, 1, 3]])), "must name the 3 vertices, got 3"),
    (lambda: CUBE.deform_mesh(np.eye(3), np.array([[0, 1, -1]])), "the 3 vertices, got -1"),
    (lambda: CUBE.deform_mesh(np.eye(3), np.eye(4, dtype=int)), r"shape \(any, 3\), got \(4, 4\)"),
    (lambda: PLAIN.with_control(np.zeros((4, 4, 4, 3))), r"control must have shape \(6, 4, 5, 3\)"),
    (lambda: box_lattice(LOW, EXTENT * [1, 0, 1], COUNTS), "extent must be positive"),
    (lambda: box_lattice(LOW, EXTENT, (6, 3, 5)), "count must be larger than the degree 3, got 3"),
    (lambda: layered_lattice(BOX, [LatticeLayer()] * 3), "count must be larger than the degree 3"),
    (lambda: pull_points(CUBE, np.zeros((1, 2)), ONE), r"points must have shape \(any, 3\)"),
    (lambda: pull_points(CUBE, ONE, np.zeros((2, 3))), r"targets must have shape \(1, 3\)"),
    (lambda: pull_points(CUBE, ONE, ONE * math.nan), "targets must be finite"),
    (lambda: pull_points(CUBE, ONE + 1.0, ONE), "points must lie in the lattice"),
    (lambda: fold_report(CUBE, ONE + 1.0), "points must lie in the lattice"),
])  # fmt: skip
def test_bad_input_is_refused(call: Callable[[], object], words: str):
    with pytest.raises(ValueError, match=words):
        call()
