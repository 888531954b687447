from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.core.geometry.meshes import solidity
from palpate.core.shapes import Mesh
from palpate.core.shapes.tessellations import icosphere
from palpate.launch.files import InputError, MeasuredContours
from palpate.messages.types import Truth
from tests.studies import thesis
from tests.studies.rebuilt import MeshErrors, truth_of_mesh
from tests.studies.thesis import (
    EXAMPLE_HEIGHT,
    EXAMPLE_NOISE,
    EXAMPLES,
    FIRST,
    NOISY_VARIANTS,
    RECORDED_WAYS,
    SECOND,
    VARIANTS,
    ThesisFigures,
    example_truth,
    judge,
    recorded_rows,
    spline_loft,
    stepped_example,
    thesis_rows,
    with_noise,
)


@pytest.fixture
def coarse(monkeypatch):
    """Truths and lofts coarse enough to be compared in no time."""
    sizes = {"TRUE": (121, 180), "FLOOR": (91, 131), "MESH": (61, 80)}
    for name, (rows, columns) in sizes.items():
        monkeypatch.setattr(thesis, f"{name}_ROWS", rows)
        monkeypatch.setattr(thesis, f"{name}_COLUMNS", columns)


def test_the_examples_have_as_many_contours_and_points_as_the_thesiss():
    assert [example.contours().shape for example in EXAMPLES] == [(27, 81, 3), (24, 41, 3)]
    for example in EXAMPLES:
        contours = example.contours()
        assert np.allclose(contours[:, 0], contours[:, -1], rtol=0, atol=1e-12)
        assert np.ptp(contours[:, 0, 2]) == EXAMPLE_HEIGHT
        assert solidity(*example.mesh(40, 60)).watertight
    assert np.ptp(np.diff(FIRST.heights)) < 1e-12
    assert np.ptp(np.diff(SECOND.heights)) > 0.1


def test_the_thesiss_rule_chooses_the_24_heights_of_its_second_example():
    printed, fitted = (stepped_example(short=short) for short in (False, True))
    assert len(printed.heights) == len(fitted.heights) == 24
    for one in (printed, fitted):
        assert 0.0 in np.round(one.heights, 12)  # it begins at half height
        assert (np.diff(one.heights) > 0.0).all()
        assert np.abs(one.heights).max() < 1.0
    # The first step of (3.1) knows nothing of the others.
    gaps = np.diff(printed.heights)
    assert gaps.max() > 3.0 * np.median(gaps)
    gaps = np.diff(fitted.heights)
    assert gaps.max() < 1.5 * np.median(gaps)


@pytest.mark.usefixtures("coarse")
def test_what_the_page_says_of_the_ways_holds():
    truth, contours = example_truth(SECOND), SECOND.contours()
    errors = {
        way.name: truth.errors_of(way.build(contours)) for way in VARIANTS if "4.3" not in way.name
    }
    assert errors["spline loft"].chamfer < 0.1 * errors["corrected"].chamfer
    assert errors["palpate, skin"].chamfer < 0.1 * errors["corrected"].chamfer
    assert errors["7 x 7 layers"].chamfer < 0.7 * errors["corrected"].chamfer
    assert errors["corrected"].chamfer < 0.8 * errors["program"].chamfer
    assert errors["corrected"].chamfer <= 0.0045
    assert errors["program"].chamfer <= 0.005
    assert errors["ellipsoid"].volume < -0.1
    assert errors["program"].hausdorff > errors["program"].rms > errors["program"].chamfer


def test_a_row_for_each_way_says_what_it_missed(monkeypatch):
    errors = MeshErrors(0.001, 0.002, 0.01, 3.0, -0.02)
    ways = (VARIANTS[0], VARIANTS[0]._replace(name="strict", most=1e-9))
    monkeypatch.setattr(thesis, "VARIANTS", ways)
    monkeypatch.setattr(thesis, "NOISY_VARIANTS", (NOISY_VARIANTS[0],))
    monkeypatch.setattr(thesis, "EXAMPLES", (SECOND,))
    stepped = {True: SECOND._replace(name="stepped"), False: SECOND._replace(name="as printed")}
    monkeypatch.setattr(thesis, "stepped_example", lambda short: stepped[short])
    monkeypatch.setattr(thesis, "judge", lambda name, *_: ThesisFigures(name, errors))
    for rows in ("TRUE_ROWS", "TRUE_COLUMNS", "FLOOR_ROWS", "FLOOR_COLUMNS"):
        monkeypatch.setattr(thesis, rows, 11)
    found = [row for row in thesis_rows(True) if not isinstance(row, str)]
    assert [row.name for row in found] == [
        *(f"example 2: {name}" for name in ("floor", "spline loft", "strict")),
        *(f"as printed: {name}" for name in ("floor", "spline loft", "strict")),
        *(f"stepped: {name}" for name in ("floor", "spline loft", "strict")),
        "example 1, noise: floor",
        "example 1, noise: spline loft",
    ]
    # Contours at other heights have no demand.
    assert [row.name for row in found if not row.holds] == ["example 2: strict"]


def test_noise_keeps_contours_closed_and_level():
    contours = FIRST.contours()
    noisy = with_noise(contours)
    assert np.array_equal(noisy[:, 0], noisy[:, -1])
    assert np.array_equal(noisy[..., 2], contours[..., 2])
    spread = (noisy - contours)[:, :-1, :2].std()
    assert spread == pytest.approx(EXAMPLE_NOISE * EXAMPLE_HEIGHT, rel=0.05)


def test_a_loft_passes_the_contours():
    contours = FIRST.contours()
    mesh = spline_loft(contours)
    assert solidity(*mesh).watertight
    ends = mesh.vertices[1:241], mesh.vertices[-241:-1]
    assert np.allclose(ends[0][::3], contours[0, :-1], rtol=0, atol=1e-12)
    assert np.allclose(ends[1][::3], contours[-1, :-1], rtol=0, atol=1e-12)


def test_the_side_is_judged_by_itself():
    ball = Mesh(*icosphere(4))
    truth = truth_of_mesh(ball, 2.0)
    high = ball.vertices[:, 2] > 0.99
    cut = ball._replace(vertices=np.where(high[:, None], 0.9 * ball.vertices, ball.vertices))
    side = ball.vertices[np.abs(ball.vertices[:, 2]) < 0.9]
    found = judge("a ball without its top", truth, side, lambda: cut)
    assert found.errors.rms > 1e-4
    assert found.side == pytest.approx(0.0, abs=1e-12)
    assert found.seconds is not None


def test_a_line_has_its_figures_with_units():
    errors = MeshErrors(0.001, 0.002, 0.01, 3.0, -0.02)
    line = ThesisFigures("a: way", errors, 0.003, 0.25, most=0.0005)
    assert str(line).split("way")[1].split() == [
        *("0.100%", "0.200%", "0.300%", "3.0", "deg", "-2.0%", "250", "ms"),
        *("<=", "0.05%", "MISSED"),
    ]
    figures = {one.name: (one.value, one.unit) for one in line.figures}
    assert figures == {
        "chamfer": (pytest.approx(0.1), "% of height"),
        "rms": (pytest.approx(0.2), "% of height"),
        "side": (pytest.approx(0.3), "% of height"),
        "normals": (3.0, "deg"),
        "volume": (-2.0, "%"),
        "time": (250.0, "ms"),
    }
    assert len(line._replace(side=None, seconds=None).figures) == 4


def ball_contours() -> MeasuredContours:
    """A ball of 40 mm, each contour begun elsewhere and with another number of points."""
    heights = 0.02 * np.sin(np.linspace(-1.3, 1.3, 12))
    rings = []
    for number, z in enumerate(heights):
        turns = number + np.linspace(0.0, 2.0 * np.pi, 60 + number, endpoint=False)
        radius = np.sqrt(0.02**2 - z**2)
        ring = [radius * np.cos(turns), radius * np.sin(turns), np.full(len(turns), z)]
        rings.append(np.stack(ring, axis=1))
    return MeasuredContours(tuple(rings), tuple(f"contour {i}" for i in range(12)))


@pytest.fixture
def recorded(monkeypatch, tmp_path):
    """A run whose recording is not read but made up."""
    (ball, faces), (floor, rough) = icosphere(4), icosphere(3)
    truth = Truth(
        vertices=0.02 * ball,
        faces=faces,
        floor_vertices=0.02 * floor,
        floor_faces=rough,
        height=0.04,
    )
    monkeypatch.setattr(thesis, "find_bag", lambda run: run)
    monkeypatch.setattr(thesis, "read_truth", lambda run: truth)
    monkeypatch.setattr(thesis, "read_points", lambda run: ball_contours())
    monkeypatch.setattr(thesis, "ROUNDS", 1)
    return tmp_path / "ball"


@pytest.mark.usefixtures("coarse")
def test_a_recording_is_rebuilt_in_each_way_and_held_against_its_truth(recorded):
    head, floor, *rows = recorded_rows(True, (recorded,))
    assert isinstance(head, str)
    assert str(floor).startswith("ball: floor")
    assert [row.name for row in rows] == [f"ball: {way}" for way in RECORDED_WAYS]
    program, corrected, skin, lattice = rows
    assert skin.side < 0.1 * min(program.side, corrected.side)
    assert lattice.side < 0.1 * min(program.side, corrected.side)
    assert max(program.errors.chamfer, corrected.errors.chamfer) < 0.05


def test_without_a_recording_a_few_are_made(monkeypatch):
    made: list[str] = []
    monkeypatch.setattr(thesis, "run_scene", lambda scene, out: made.append(scene))
    monkeypatch.setattr(thesis, "rebuilt_rows", lambda run: iter([run.name]))
    assert list(recorded_rows(True)) == [thesis.HEAD, "vase"]
    assert list(recorded_rows(False)) == [thesis.HEAD, "egg", "vase", "notched"]
    assert made == ["vase", "egg", "vase", "notched"]


def test_what_cannot_be_compared_is_one_sentence(monkeypatch, recorded, tmp_path):
    def refuse(found: MeasuredContours) -> None:
        raise ValueError("contours must be closed")

    monkeypatch.setattr(thesis, "RECORDED_WAYS", {"some way": refuse})
    words = f"{recorded}: cannot be rebuilt by some way: contours must be closed"
    with pytest.raises(InputError, match=words):
        list(recorded_rows(True, (recorded,)))
    monkeypatch.undo()
    with pytest.raises(InputError, match="the recording does not exist"):
        next(iter(recorded_rows(True, (Path("nowhere"),))))
    junk = tmp_path / "junk.mcap"
    junk.write_bytes(b"junk")
    with pytest.raises(InputError, match="junk"):
        thesis.read_truth(junk)


class Untrue:
    """A recording of a real object."""

    def messages(self) -> list[object]:
        return []


def test_a_recording_of_a_real_object_has_no_truth_to_compare_with(monkeypatch, tmp_path):
    monkeypatch.setattr(thesis, "find_bag", lambda run: run)
    monkeypatch.setattr(thesis, "open_recording", lambda path: Untrue())
    with pytest.raises(InputError, match="holds no /truth to compare with"):
        thesis.read_truth(tmp_path)
