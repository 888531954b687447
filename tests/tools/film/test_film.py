"""Pictures drawn without a screen, and films of runs made of them."""

import shutil
import subprocess
from itertools import product

import numpy as np
import pytest
from PIL import Image, ImageSequence

from palpate.launch.files.source_map import InputError
from palpate.tools.cli.command_line import run
from palpate.tools.film.film import make_film
from palpate.tools.view.rasteriser import Camera, Canvas, camera_on
from palpate.tools.view.timeline import Timeline


def frames_of(path):
    with Image.open(path) as film:
        return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]


@pytest.fixture(scope="module")
def frames(run_folder, tmp_path_factory):
    """Ten frames of a film of the run."""
    path = tmp_path_factory.mktemp("film") / "run.gif"
    said: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("click.echo", lambda text, err=False: said.append(text))
        assert run(["film", str(run_folder), "-o", str(path), "--seconds", "1"]) == 0
    assert said == [*(f"drawing      {share} %" for share in range(0, 100, 10)), f"{path}: written"]
    return frames_of(path)


def test_film_shows_the_exploration_from_beginning_to_end(frames):
    assert len(frames) == 10 and frames[0].shape == (360, 640, 3)
    scenes = [frame[:330, :390] for frame in frames]  # without the legend below them
    assert (scenes[0] == 255).all()  # nothing is touched yet
    pixels = [(scene != 255).any(axis=2).sum() for scene in scenes]
    assert pixels[-1] > 5000 and max(pixels[:3]) < pixels[-1]
    assert len({frame.tobytes() for frame in frames}) == 10
    # The last show the colours of deviation.
    purple = [(frame[:330, :390].astype(int) @ [1, -2, 1] > 40).sum() for frame in frames]
    assert purple[-1] > 300 and max(purple[:7]) < purple[-1] / 3


def test_texts_stay_off_the_edges_of_a_film(line, tmp_path):
    scores, estimates = line.scores, line.estimates
    long = Timeline(known=line.known, grasps=200 * line.grasps, scores=scores, estimates=estimates)
    long.touches = [touch._replace(time=1e4 * touch.time) for touch in line.touches]
    make_film(long, tmp_path / "long.gif", seconds=0.4, say=print)
    for picture in frames_of(tmp_path / "long.gif"):
        assert (picture[:, -640 // 50 :] == 255).all()
        assert (picture[-2:, -640 // 3 :] == 255).all()


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_mp4_has_its_length_and_rate(line, tmp_path):
    path = tmp_path / "run.mp4"
    make_film(line, path, seconds=0.5, say=print)
    probe = ["ffprobe", "-v", "error", "-count_frames", "-show_entries"]
    probe += ["stream=width,height,nb_read_frames,r_frame_rate", "-of", "csv=p=0", str(path)]
    result = subprocess.run(probe, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "960,540,20/1,10"


def test_failed_film_leaves_no_file(line, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    program.write_text("#!/bin/sh\necho no such codec >&2\nexit 1\n")
    program.chmod(0o755)
    with pytest.raises(InputError, match="ffmpeg failed: no such codec"):
        make_film(line, tmp_path / "run.mp4", seconds=0.1, say=print)
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(InputError, match="mp4 needs ffmpeg, which is not installed"):
        make_film(line, tmp_path / "run.mp4", say=print)
    with pytest.raises(InputError, match="no touches"):
        make_film(Timeline(), tmp_path / "run.gif", say=print)
    assert [path.name for path in tmp_path.iterdir()] == ["ffmpeg"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("RUN", "Missing option '-o'"),
        ("nowhere -o x.gif", "nowhere"),
        ("RUN -o x.avi", "must end in .mp4 or .gif"),
        ("RUN -o there.gif", "exists already"),
        ("RUN -o x.gif --seconds 0", "0.0 is not in the range"),
        ("RUN -o x.gif --seconds nan", "seconds must be a finite number, got nan"),
    ],
)
def test_film_command_refuses_bad_arguments(here, run_folder, refusal, words, message):
    (here / "there.gif").touch()
    assert message in refusal("film", *words.replace("RUN", str(run_folder)).split())
    assert [path.name for path in here.iterdir()] == ["there.gif"]


SQUARE = np.array([[0.0, -1, -1], [0, 1, -1], [0, 1, 1], [0, -1, 1]])  # seen from the x axis
HALVES = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
RED, GREEN = np.array([255, 0, 0]), np.array([0, 255, 0])
FRONT = Camera(np.zeros(3), 10.0, azimuth=0.0, elevation=0.0)


def drawn(*layers, size=(60, 60), camera=FRONT, lit=False):
    """A picture of squares, each with its colours."""
    canvas = Canvas(*size, camera)
    for vertices, colours in layers:
        canvas.draw_mesh(vertices, HALVES, colours, lit=lit)
    return canvas.image()


def turned(c, s):
    return SQUARE @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T


def test_square_covers_the_pixels_of_its_perspective():
    red = (drawn((SQUARE, RED), size=(200, 100)) == RED).all(axis=2)
    side = 100 / (2.0 * 10.0 * np.tan(np.radians(14.0))) * 2.0  # pixels of 2 m at 10 m
    assert red.sum(axis=1).max() == pytest.approx(side, abs=1.0)
    assert red.sum(axis=0).max() == pytest.approx(side, abs=1.0)
    rows, columns = np.nonzero(red)
    assert (rows.mean(), columns.mean()) == pytest.approx((49.5, 99.5), abs=0.6)
    canvas = Canvas(40, 40, FRONT)
    for away in ([20.0, 0, 0], [0.0, 50, 0]):  # behind the eye, and beside the picture
        canvas.draw_mesh(SQUARE + away, HALVES, RED, lit=False)
        canvas.draw_points(np.array([away]), RED, 3.0)
    canvas.draw_line(np.zeros((1, 3)), RED, 2.0)
    assert (canvas.image() == 255).all()


def test_camera_axes_are_a_right_handed_frame_and_see_all_of_a_box():
    axes = Camera(np.zeros(3), 1.0, azimuth=90.0, elevation=0.0).axes()
    assert axes == pytest.approx(np.array([[-1, 0, 0], [0, 0, 1], [0, 1, 0]]))  # right, up, back
    for azimuth, elevation in ((20.0, 50.0), (-170.0, -80.0)):
        axes = Camera(np.zeros(3), 1.0, azimuth=azimuth, elevation=elevation).axes()
        assert axes @ axes.T == pytest.approx(np.eye(3)) and np.linalg.det(axes) > 0.0
    low, high = np.array([0.0, 0, 0]), np.array([0.3, 0.1, 0.5])
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    for azimuth, elevation in product(range(0, 360, 30), (-60.0, 0.0, 45.0)):
        camera = camera_on(low, high, azimuth=float(azimuth), elevation=elevation)
        canvas = Canvas(100, 100, camera)
        flat = canvas.project(corners)[:, :2]
        assert flat.min() >= 0.0 and flat.max() <= 100 * canvas.settings.supersampling


@pytest.mark.parametrize("order", [1, -1])
def test_nearer_surface_hides_the_farther_one(order):
    layers = [(SQUARE, RED), (SQUARE + [-1.0, 0, 0], GREEN)][::order]
    assert (drawn(*layers)[30, 30] == RED).all()
    picture = drawn(*[(SQUARE, RED), (turned(0.8, 0.6), GREEN)][::order], size=(80, 80))
    # Two squares that cross meet in the middle; the turned one comes nearer at the right.
    assert (picture[40, 36] == RED).all() and (picture[40, 44] == GREEN).all()


def test_colours_run_evenly_between_corners_and_are_bright_towards_the_light():
    colours = np.zeros((4, 3))
    colours[[1, 2], 0] = 200.0
    far = Camera(np.zeros(3), 1000.0, 0.0, 0.0, opening=0.12)
    row = drawn((SQUARE, colours), size=(200, 200), camera=far)[100].astype(float)
    inside = np.flatnonzero(row[:, 1] == 0)
    shares = (inside - inside[0]) / (inside[-1] - inside[0])
    assert np.abs(row[inside, 0] - 200.0 * shares).max() < 3.0
    front, side = (
        drawn((square, np.full(3, 200)), lit=True)[30, 30, 0]
        for square in (SQUARE, turned(0.2, -0.98))
    )
    assert side < front


def test_back_faces_of_a_closed_mesh_change_nothing():
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)
    pictures = []
    for kept in (faces, np.concatenate([faces, faces[:1]])):  # an edge walked twice: not closed
        canvas = Canvas(90, 90, camera_on(vertices.min(axis=0), vertices.max(axis=0)))
        canvas.draw_mesh(vertices, kept, np.array([200, 100, 50]), lit=False)
        pictures.append(canvas.image())
    assert (pictures[0] == pictures[1]).all() and (pictures[0] != 255).any()


@pytest.mark.parametrize(("depth", "seen"), [(0.0, True), (-0.5, False)])
def test_points_and_lines_are_hidden_behind_surfaces(depth, seen):
    place = np.array([[depth, 0.0, 0.0]])
    canvas = Canvas(60, 60, FRONT)
    canvas.draw_mesh(SQUARE, HALVES, RED, lit=False)
    canvas.draw_points(place, GREEN, 2.0)
    assert (canvas.image()[30, 30] == GREEN).all() == seen
    canvas.draw_line(place + [[0, -0.5, 0.3], [0, 0.5, 0.3]], GREEN, 2.0)
    assert bool((canvas.image()[24:28] == GREEN).all(axis=2).any()) == seen
    # A closed line has one side more.
    counts = []
    for closed in (False, True):
        canvas = Canvas(80, 80, FRONT)
        canvas.draw_line(SQUARE * 0.5, RED, 1.0, closed=closed)
        counts.append(int((canvas.image() != 255).any(axis=2).sum()))
    assert counts[1] == pytest.approx(counts[0] * 4 / 3, rel=0.1)


def test_layer_is_blended_where_it_is_nearer():
    base, layer = Canvas(60, 60, FRONT), Canvas(60, 60, FRONT)
    base.draw_mesh(SQUARE, HALVES, RED, lit=False)
    layer.draw_mesh(SQUARE * 0.5 + [1.0, 0, 0], HALVES, GREEN, lit=False)
    base.blend(layer, 0.5)
    assert base.image()[30, 30].tolist() == [128, 128, 0]
    assert (base.image()[18, 18] == RED).all()
