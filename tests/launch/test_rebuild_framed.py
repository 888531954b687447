from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.frames import inverse, transform
from palpate.launch.cli import main as cli
from palpate.launch.points_found import PointsFound
from palpate.launch.score_files import read_shape
from palpate.launch.solid_file import load

Output = pytest.CaptureFixture[str]
TURN = 2 * np.pi * np.arange(30) / 30
HEIGHTS = np.linspace(-0.045, 0.045, 10)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> int:
    return cli.run(["rebuild", *arguments])


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Floats:
    """Pose of the tilted frame in which a recorded ellipsoid of 100 mm was sliced."""
    frame = np.array([0.01, 0.0, 0.05, 0.28, 0.0, 0.0, 0.96])
    contours = []
    for z in HEIGHTS:
        r = 0.03 * np.sqrt(1.0 - (z / 0.05) ** 2)
        ring = np.column_stack([r * np.cos(TURN), 0.8 * r * np.sin(TURN), np.full(len(TURN), z)])
        contours.append(transform(frame, ring))
    places = tuple(f"contour {i}" for i in range(len(contours)))
    found = PointsFound(tuple(contours), places, frame=frame)
    monkeypatch.setattr("palpate.launch.rebuild.read_points", lambda path: found)
    return frame


def test_a_recording_in_a_tilted_frame_gives_a_solid_in_the_world(
    recorded: Floats, home: Path, capsys: Output
) -> None:
    heights = ("--bottom", "-0.05", "--top", "0.05")  # along the slicing axis
    outs = ("-o", "a.ply", "-o", "a.npz", "--lattice", "a.vtk", "--json")
    assert run("a.mcap", *heights, *outs) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["uncovered_m"] == [0.0, 0.0]
    assert not any("touched at" in text for text in record["warnings"])
    solid = load(home / "a.npz")
    shape = read_shape(home / "a.ply", "m")
    for points in (solid.mesh().vertices, shape.vertices):
        local = transform(inverse(recorded), points) / [0.03, 0.024, 0.05]
        assert np.linalg.norm(local, axis=1) == pytest.approx(1.0, abs=1e-3)
    assert solid.control_lattice is not None
    first = repr(float(solid.control_lattice.control[0, 0, 0, 0]))
    assert f"\n{first} " in (home / "a.vtk").read_text()


def test_ends_along_a_tilted_axis_are_doubted_by_their_height(
    recorded: Floats, capsys: Output
) -> None:
    assert run("a.mcap", "--top", "0.08", "--method", "coarse") == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "the top was touched at height 80 mm, and the solid ends at" in text
    assert run("a.mcap", "--top", "0.01") == cli.BAD_INPUT
    assert (
        "--top 0.01: must lie beyond the contours, which go from -0.045" in capsys.readouterr().err
    )
