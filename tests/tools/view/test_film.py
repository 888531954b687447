from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image, ImageSequence

from palpate.core import split_pose
from palpate.launch.files import InputError
from palpate.tools.cli import command_line as cli
from palpate.tools.film.film import LIFT, Film, finger_pose
from palpate.tools.view import Timeline, make_film, read_timeline


@pytest.fixture(scope="module")
def line(run_folder):
    return read_timeline(run_folder)


def test_a_gif_shows_the_exploration_from_beginning_to_end(run_folder, tmp_path, capsys):
    path = tmp_path / "run.gif"
    assert cli.run(["film", str(run_folder), "-o", str(path), "--seconds", "1"]) == 0
    told = capsys.readouterr()
    assert told.out == f"{path}: written\n"
    assert told.err.splitlines()[0] == "drawing      0 %"
    with Image.open(path) as film:
        frames = [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)]
    assert len(frames) == 10
    assert frames[0].shape == (360, 640, 3)
    scenes = [one[:330, :390] for one in frames]  # without the legend below them
    assert (scenes[0] == 255).all()  # nothing is touched yet
    drawn = [(one != 255).any(axis=2).sum() for one in scenes]
    assert drawn[-1] > 5000
    assert max(drawn[:3]) < drawn[-1]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_an_mp4_has_its_length_and_rate(line, tmp_path):
    path = tmp_path / "run.mp4"
    make_film(line, path, seconds=0.5, say=lambda _: None)
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries"]
    probe += ["stream=width,height,nb_read_frames,r_frame_rate", "-of", "csv=p=0", str(path)]
    found = subprocess.run(probe, capture_output=True, text=True, check=True).stdout
    assert found.strip() == "960,540,20/1,10"


def test_the_solid_at_the_end_has_the_colours_of_its_deviation(line):
    film = Film(line, 320, 180)
    assert film.colours is not None
    last, before = film.frame(1.0), film.frame(0.79)
    purple = (last[:, :190].astype(int) @ [1, -2, 1] > 40).sum()
    assert purple > 300
    assert (before[:, :190].astype(int) @ [1, -2, 1] > 40).sum() < purple / 3


def test_the_finger_is_on_the_surface_at_a_touch_and_off_it_between(line):
    for one, after in zip(line.touches, line.touches[1:], strict=False):
        assert finger_pose(line, one.time)[:3] == pytest.approx(one.pose[:3])
        between = finger_pose(line, 0.5 * (one.time + after.time))
        assert np.linalg.norm(between[3:]) == pytest.approx(1.0)
        middle, axis = 0.5 * (one.pose[:3] + after.pose[:3]), split_pose(between)[1][:, 2]
        assert between[:3] == pytest.approx(middle - LIFT * axis, abs=1e-9)


@pytest.mark.parametrize("size", [(640, 360), (960, 540)])
def test_no_word_of_a_film_reaches_its_edge(line, size):
    long = Timeline(
        pad=line.pad, grasps=200 * line.grasps, scores=line.scores, estimates=line.estimates
    )
    long.touches = [one._replace(time=1e4 * one.time) for one in line.touches]
    for share in (0.0, 0.02, 0.5, 0.79, 1.0):
        picture = Film(long, *size).frame(share)
        assert (picture[:, -size[0] // 50 :] == 255).all()
        assert (picture[-2:, -size[0] // 3 :] == 255).all()


@pytest.mark.parametrize(
    ("name", "why"), [("run.avi", "must end in .mp4 or .gif"), ("there.gif", "exists already")]
)
def test_a_film_that_cannot_be_written_is_refused(line, tmp_path, name, why):
    (tmp_path / "there.gif").write_bytes(b"")
    with pytest.raises(InputError, match=why):
        make_film(line, tmp_path / name, say=lambda _: None)
    assert [one.name for one in tmp_path.iterdir()] == ["there.gif"]


def test_mp4_without_ffmpeg_is_refused_in_a_sentence(line, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(InputError, match="mp4 takes ffmpeg, which is not installed"):
        make_film(line, tmp_path / "run.mp4", say=lambda _: None)


def test_ffmpeg_that_fails_leaves_nothing(line, tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    program = tmp_path / "bin" / "ffmpeg"
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:/usr/bin:/bin")
    with pytest.raises(InputError, match="ffmpeg failed: no such codec"):
        make_film(line, tmp_path / "run.mp4", seconds=0.2, say=lambda _: None)
    assert not (tmp_path / "run.mp4").exists()


def test_a_film_has_a_finite_length(line, tmp_path):
    with pytest.raises(InputError, match="seconds must be a finite number, got nan"):
        make_film(line, tmp_path / "run.gif", seconds=float("nan"), say=lambda _: None)
    assert not list(tmp_path.iterdir())


def test_a_run_without_touches_has_no_film(tmp_path):
    with pytest.raises(InputError, match="no touches"):
        make_film(Timeline(), tmp_path / "run.gif", say=lambda _: None)
