"""Figures of the thesis: each is drawn as it is kept, and the page shows them all."""

import io
import json
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from palpate.tools.gallery.sheet import FIGURES, draw_png, find_figures

DOCS = Path(__file__).parents[3] / "docs"
KEPT = DOCS / "gallery"
CHEAP = ("bernstein", "step_components", "correspondence", "lattice")
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in FIGURES if name not in CHEAP]


def pixels(png):
    with Image.open(io.BytesIO(png)) as picture:
        return np.asarray(picture.convert("RGB"))


@pytest.mark.parametrize("name", [*CHEAP, *SLOW])
def test_figure_equals_stored_picture(name):
    drawn, kept = pixels(draw_png(name)), pixels((KEPT / f"{name}.png").read_bytes())
    assert drawn.shape == kept.shape
    compared = np.s_[:]
    if name == "cost":  # the rest shows processor times, which differ from run to run
        compared = np.s_[: drawn.shape[0] // 2, : 3 * drawn.shape[1] // 5]
    # of 255; another font makes a few
    assert np.abs(drawn[compared].astype(float) - kept[compared]).mean() < 6.0
    high, wide = (length // 4 for length in drawn.shape[:2])
    middle = drawn[high:-high, wide:-wide].reshape(-1, 3)
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) >= 8
    assert 0.01 < (middle != 255).any(axis=1).mean() < 0.99


def test_page_shows_every_figure_of_the_thesis_with_its_caption():
    shown = {}
    for picture, line in pairwise((DOCS / "gallery.md").read_text().split("\n\n")):
        if match := re.fullmatch(r"!\[(.{8,})\]\(gallery/(\w+)\.png\)", picture):
            shown[match[2]] = line.strip()
    assert list(shown) == list(FIGURES)
    for name, figure in FIGURES.items():
        numbers = " to ".join(dict.fromkeys((*figure.numbers[:1], *figure.numbers[-1:])))
        assert shown[name] == (f"**{numbers}** " if numbers else "") + figure.caption
    sizes = {path.stem: path.stat().st_size for path in KEPT.glob("*")}
    assert {*sizes} == {*FIGURES}
    assert max(sizes.values()) <= 100_000 and sum(sizes.values()) <= 1_500_000

    assert find_figures(["5.12", "bernstein", "example_1", "2.4"]) == ["example_1", "bernstein"]
    assert find_figures([]) == list(FIGURES)
    numbers = [number for figure in FIGURES.values() for number in figure.numbers]
    assert len(numbers) == len({*numbers})
    chapters = {"1": 1, "2": 9, "3": 10, "4": 3, "5": 20}
    printed = {f"{c}.{n}" for c, count in chapters.items() for n in range(1, count + 1)}
    assert {*numbers} == printed


def test_gallery_command_draws_and_lists(here, call):
    code, out, err = call("gallery 2.4 step_components -o a/b --json")
    assert (code, err) == (0, "drawing bernstein\ndrawing step_components\n")
    assert json.loads(out) == ["a/b/bernstein.png", "a/b/step_components.png"]
    before = Path("a/b/bernstein.png").read_bytes()
    assert call("gallery 2.4 -o a/b").code == 0
    assert Path("a/b/bernstein.png").read_bytes() == before
    listed = json.loads(call("gallery --list --json run 3.10").out)
    shows = {name: facts["shows"] for name, facts in listed.items()}
    assert shows == {"run": "ours", "step_function": "3.9 to 3.10"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("lattce -o made", "there is no figure 'lattce'; did you mean 'lattice'?"),
        ("2.10 -o made", "there is no figure '2.10'; see palpate gallery --list"),
        ("bernstein -o file", "file: cannot be made: File exists"),
    ],
)
def test_unknown_figure_or_bad_folder_is_refused(here, refusal, words, message):
    Path("file").touch()
    assert refusal(f"gallery bernstein {words}") == f"palpate: {message}\n"
    assert [path.name for path in here.iterdir()] == ["file"]
