import io
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from palpate.core.geometry import solidity
from palpate.core.shapes import Superquadric
from palpate.tools.cli import command_line as cli
from palpate.tools.gallery import FIGURES, draw_png, find_figures, style
from palpate.tools.gallery.shapes import solid_mesh
from palpate.tools.view import FINER, Canvas

DOCS = Path(__file__).parents[2] / "docs"
KEPT = DOCS / "gallery"
CHEAP = ("bernstein", "step_components", "correspondence", "lattice")
MOST_BYTES, ALL_BYTES = 100_000, 1_500_000
ALIKE = 6.0  # Mean difference of two drawings of one figure, of 255: another font, say


def pixels(png: bytes) -> np.ndarray:
    """The picture (height, width, 3) in a file."""
    with Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("RGB"))


def is_drawn(picture: np.ndarray) -> bool:
    """Whether there are several colours, and more than ground in the middle."""
    high, wide = (length // 4 for length in picture.shape[:2])
    middle = picture[high:-high, wide:-wide].reshape(-1, 3)
    colours = np.unique(picture.reshape(-1, 3), axis=0)
    return bool(len(colours) >= 8 and 0.01 < (middle != 255).any(axis=1).mean() < 0.99)


@pytest.mark.parametrize("name", CHEAP)
def test_a_figure_shows_something_and_is_the_one_that_is_kept(name):
    check_figure(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FIGURES if name not in CHEAP])
def test_every_figure_shows_something_and_is_the_one_that_is_kept(name):
    check_figure(name)


def check_figure(name: str) -> None:
    drawn, kept = pixels(draw_png(name)), pixels((KEPT / f"{name}.png").read_bytes())
    assert is_drawn(drawn)
    assert drawn.shape == kept.shape
    assert drawn.shape[1] == style.WIDTH * style.DPI
    assert np.abs(drawn.astype(float) - kept).mean() < ALIKE


def test_an_empty_picture_and_empty_axes_are_noticed():
    white = np.full((100, 200, 3), 255, np.uint8)
    assert not is_drawn(white)
    ramp = white.copy()
    ramp[:4] = np.arange(200)[:, None]  # a title over nothing
    assert not is_drawn(ramp)
    ramp[40:60] = np.arange(200)[:, None]
    assert is_drawn(ramp)


def test_the_page_shows_every_figure_with_its_line_and_no_other():
    blocks = (DOCS / "gallery.md").read_text().split("\n\n")
    shown = {}
    for picture, line in pairwise(blocks):
        if found := re.fullmatch(r"!\[(.{8,})\]\(gallery/(\w+)\.png\)", picture):
            shown[found[2]] = line.strip()
    assert list(shown) == list(FIGURES)
    for name, one in FIGURES.items():
        numbers = " to ".join(dict.fromkeys((*one.numbers[:1], *one.numbers[-1:])))
        assert shown[name] == (f"**{numbers}** " if numbers else "") + one.caption
    kept = {path.stem: path.stat().st_size for path in KEPT.glob("*")}
    assert set(kept) == set(FIGURES)
    assert max(kept.values()) <= MOST_BYTES
    assert sum(kept.values()) <= ALL_BYTES


def test_a_figure_is_meant_by_its_name_or_by_any_number_of_the_thesis():
    assert find_figures(["5.12", "bernstein", "example_1", "2.4"]) == ["example_1", "bernstein"]
    assert find_figures([]) == list(FIGURES)
    numbers = [number for one in FIGURES.values() for number in one.numbers]
    assert len(numbers) == len(set(numbers))
    # Sketches and photographs are not drawn: of a sensor, a flow chart, a box, an edge model.
    chapters = {"2": 9, "3": 10, "4": 3, "5": 20}
    printed = {f"{c}.{n}" for c, most in chapters.items() for n in range(1, most + 1)}
    assert printed - set(numbers) == {"2.5", "2.6", "2.9", "3.1", "3.2"}
    assert set(numbers) <= printed


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("sperquadrics", "there is no figure 'sperquadrics'; did you mean 'superquadrics'?"),
        ("2.9", "there is no figure '2.9'; see palpate gallery --list"),
    ],
)
def test_an_unknown_figure_is_refused_before_anything_is_drawn(asked, told, tmp_path, capsys):
    out = tmp_path / "made"
    assert cli.run(["gallery", "bernstein", asked, "-o", str(out)]) == 2
    assert capsys.readouterr().err == f"palpate: {told}\n"
    assert not out.exists()


def test_figures_are_written_into_a_folder_and_told_one_by_one(tmp_path, capsys):
    out = tmp_path / "a" / "b"
    assert cli.run(["gallery", "2.4", "step_components", "-o", str(out), "--json"]) == 0
    told = capsys.readouterr()
    assert told.err == "drawing bernstein\ndrawing step_components\n"
    files = [str(out / "bernstein.png"), str(out / "step_components.png")]
    assert json.loads(told.out) == files
    assert sorted(map(str, out.iterdir())) == files
    before = (out / "bernstein.png").read_bytes()
    assert cli.run(["gallery", "2.4", "-o", str(out)]) == 0
    assert (out / "bernstein.png").read_bytes() == before


def test_a_folder_that_cannot_be_made_is_refused_in_a_sentence(tmp_path, capsys):
    (tmp_path / "file").touch()
    assert cli.run(["gallery", "bernstein", "-o", str(tmp_path / "file")]) == 2
    assert capsys.readouterr().err == f"palpate: {tmp_path}/file: cannot be made: File exists\n"


def test_the_list_tells_numbers_and_captions_and_draws_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.run(["gallery", "--list", "--json", "run", "3.10"]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert {name: one["shows"] for name, one in listed.items()} == {
        "run": "ours", "step_function": "3.9 to 3.10",
    }  # fmt: skip
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("view", [style.OBLIQUE, style.FROM_SIDE, style.FROM_TOP, (130.0, -40.0)])
@pytest.mark.parametrize("shape", [(100, 300), (300, 100)])
def test_a_fitted_camera_leaves_no_more_than_a_margin(view, shape):
    points = np.random.default_rng(0).normal(size=(50, 3)) * [3.0, 1.0, 2.0] + 7.0
    canvas = Canvas(shape[1], shape[0], style.fitted_camera(points, view, shape))
    flat = canvas.project(points)[:, :2] / FINER
    middle = 0.5 * np.array([shape[1], shape[0]])
    reached = (np.abs(flat - middle) / middle).max()
    assert reached == pytest.approx(1.0 / style.MARGIN, abs=1e-9)


def test_the_mesh_of_a_grid_is_turned_outwards():
    ball = solid_mesh(Superquadric(np.ones(3), np.ones(2)))
    assert solidity(ball.vertices, ball.faces).volume == pytest.approx(4.0 / 3.0 * np.pi, rel=0.01)
