"""Films of runs: what their frames show, and films that cannot be made."""

import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image, ImageSequence

from palpate.launch.files.source_map import InputError
from palpate.tools.cli.command_line import run
from palpate.tools.film.film import make_film
from palpate.tools.view.timeline import Timeline, read_timeline


@pytest.fixture(scope="module")
def line(run_folder):
    return read_timeline(run_folder)


def silent(_):
    """Takes progress."""


def frames_of(path):
    with Image.open(path) as film:
        return [np.asarray(one.convert("RGB")) for one in ImageSequence.Iterator(film)]


@pytest.fixture(scope="module")
def frames(run_folder, tmp_path_factory):
    """Ten frames of a film of the run."""
    path = tmp_path_factory.mktemp("film") / "run.gif"
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("click.echo", lambda text, err=False: said.append(text))
        assert run(["film", str(run_folder), "-o", str(path), "--seconds", "1"]) == 0
    assert said == [*(f"drawing      {one} %" for one in range(0, 100, 10)), f"{path}: written"]
    return frames_of(path)


def test_film_shows_the_exploration_from_beginning_to_end(frames):
    assert len(frames) == 10 and frames[0].shape == (360, 640, 3)
    scenes = [one[:330, :390] for one in frames]  # without the legend below them
    assert (scenes[0] == 255).all()  # nothing is touched yet
    pixels = [(one != 255).any(axis=2).sum() for one in scenes]
    assert pixels[-1] > 5000 and max(pixels[:3]) < pixels[-1]
    assert len({one.tobytes() for one in frames}) == 10


def test_last_frames_show_the_colours_of_deviation(frames):
    purple = [(one[:330, :390].astype(int) @ [1, -2, 1] > 40).sum() for one in frames]
    assert purple[-1] > 300 and max(purple[:7]) < purple[-1] / 3


def test_no_word_of_a_film_reaches_its_edge(line, tmp_path):
    scores, estimates = line.scores, line.estimates
    long = Timeline(known=line.known, grasps=200 * line.grasps, scores=scores, estimates=estimates)
    long.touches = [one._replace(time=1e4 * one.time) for one in line.touches]
    make_film(long, tmp_path / "long.gif", seconds=0.4, say=silent)
    for picture in frames_of(tmp_path / "long.gif"):
        assert (picture[:, -640 // 50 :] == 255).all()
        assert (picture[-2:, -640 // 3 :] == 255).all()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_mp4_has_its_length_and_rate(line, tmp_path):
    path = tmp_path / "run.mp4"
    make_film(line, path, seconds=0.5, say=silent)
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries"]
    probe += ["stream=width,height,nb_read_frames,r_frame_rate", "-of", "csv=p=0", str(path)]
    found = subprocess.run(probe, capture_output=True, text=True, check=True).stdout
    assert found.strip() == "960,540,20/1,10"


def test_missing_or_failing_ffmpeg_and_missing_touches_leave_nothing(line, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    program.chmod(0o755)
    with pytest.raises(InputError, match="ffmpeg failed: no such codec"):
        make_film(line, tmp_path / "run.mp4", seconds=0.1, say=silent)
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(InputError, match="mp4 takes ffmpeg, which is not installed"):
        make_film(line, tmp_path / "run.mp4", say=silent)
    with pytest.raises(InputError, match="no touches"):
        make_film(Timeline(), tmp_path / "run.gif", say=silent)
    assert [one.name for one in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("RUN", "Missing option '-o'"),
        ("nowhere -o x.gif", "nowhere"),
        ("RUN -o x.avi", "must end in .mp4 or .gif"),
        ("RUN -o there.gif", "exists already"),
        ("RUN -o x.gif --seconds 0", "0.0 is not in the range"),
        ("RUN -o x.gif --seconds nan", "seconds must be a finite number, got nan"),
    ],
)
def test_film_verb_refuses_in_one_sentence(here, run_folder, refusal, words, why):
    (here / "there.gif").touch()
    assert why in refusal("film", *words.replace("RUN", str(run_folder)).split())
    assert [one.name for one in here.iterdir()] == ["there.gif"]
