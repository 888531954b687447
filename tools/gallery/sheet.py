"""All figures by name, and how they become files."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from palpate.launch.files.file_access import write_atomically
from palpate.launch.files.source_map import InputError, hint
from palpate.tools.gallery import (
    contours,
    reconstructions,
    runs,
    shapes,
    sketches,
    style,
    touch,
)


class GalleryFigure(NamedTuple):
    """A picture that can be drawn again."""

    numbers: tuple[str, ...]  # of the thesis's figures that it shows; empty for our own
    caption: str  # one line: what it shows, and where it departs from the thesis
    draw: Callable[[], Figure]

    def facts(self) -> dict[str, str]:
        """Which of the thesis's figures it shows, and the caption."""
        if not self.numbers:
            return {"shows": "ours", "caption": self.caption}
        return {
            "shows": " to ".join(dict.fromkeys((self.numbers[0], self.numbers[-1]))),
            "caption": self.caption,
        }


def _thesis(chapter: int, first: int, last: int | None = None) -> tuple[str, ...]:
    return tuple(f"{chapter}.{number}" for number in range(first, (last or first) + 1))


FIGURES: dict[str, GalleryFigure] = {
    "array": GalleryFigure(
        _thesis(1, 1),
        "Elements under a pad: a pulse is back sooner where an object presses the pad, (1.1).",
        sketches.draw_array,
    ),
    "superellipses": GalleryFigure(
        _thesis(2, 1),
        "Superellipses. Thick: all that the formula gives as printed, with powers without sign.",
        shapes.draw_superellipses,
    ),
    "superquadrics": GalleryFigure(
        _thesis(2, 2),
        "Superquadrics of one size. Exponents over 2, which no scene takes, pinch them.",
        shapes.draw_superquadrics,
    ),
    "parametrisations": GalleryFigure(
        _thesis(2, 3),
        "One cube: (2.1) crowds lines at its edges, (2.4) spreads them, though not evenly.",
        shapes.draw_parametrisations,
    ),
    "bernstein": GalleryFigure(
        _thesis(2, 4), "The Bernstein polynomials of degree 5.", shapes.draw_bernstein
    ),
    "de_casteljau": GalleryFigure(
        _thesis(2, 5),
        "The cubic's point at 1/3: each side of the polygon is divided so, again and again.",
        sketches.draw_de_casteljau,
    ),
    "parallelepiped": GalleryFigure(
        _thesis(2, 6),
        "The box of a free-form deformation: its corner, edges and control points.",
        sketches.draw_parallelepiped,
    ),
    "b_splines": GalleryFigure(
        _thesis(2, 7),
        "Cubic B-splines on four knot vectors. Where grey, they do not sum to 1.",
        shapes.draw_b_splines,
    ),
    "hyperquadrics": GalleryFigure(
        _thesis(2, 8),
        "Hyperquadrics; those below have exponential terms, which dent or swell them.",
        shapes.draw_hyperquadrics,
    ),
    "winged_edge": GalleryFigure(
        _thesis(2, 9),
        "What an edge of a polyhedron knows: its ends, faces and neighbours.",
        sketches.draw_winged_edge,
    ),
    "preprocessing": GalleryFigure(
        _thesis(3, 1),
        "From a raw frame to curvatures, with our topics.",
        sketches.draw_preprocessing,
    ),
    "array_frame": GalleryFigure(
        _thesis(3, 2),
        "The frame of the array, and the pad's face over it, heights doubled.",
        sketches.draw_array_frame,
    ),
    "filters": GalleryFigure(
        _thesis(3, 3, 6),
        "The corner of a box on 256 taxels: raw, filtered in either order, and mended by palpate.",
        touch.draw_filters,
    ),
    "step_components": GalleryFigure(
        _thesis(3, 7, 8),
        "Both factors of the step. Curvatures are times the height, else the unit would matter.",
        touch.draw_step_components,
    ),
    "step_function": GalleryFigure(
        _thesis(3, 9, 10),
        "The step between contours, its approximation, and what that misses.",
        touch.draw_step_function,
    ),
    "correspondence": GalleryFigure(
        _thesis(4, 1, 2),
        "Contours matched by height, points by azimuth about the middle of the area.",
        contours.draw_correspondence,
    ),
    "parameter_space": GalleryFigure(
        _thesis(4, 3),
        "Parameters of the model's points: as printed, rows bend and miss its ends.",
        contours.draw_parameter_space,
    ),
    "lattice": GalleryFigure(
        _thesis(5, 1, 4),
        "An ellipsoid, the lattice around it, and the lattice pulled to and fro.",
        reconstructions.draw_lattice,
    ),
    "deformation": GalleryFigure(
        _thesis(5, 5, 8),
        "What becomes of the ellipsoid: B-splines follow the lattice, Bernstein's hardly do.",
        reconstructions.draw_deformation,
    ),
    "example_1": GalleryFigure(
        _thesis(5, 9, 14),
        "27 contours rebuilt, corrected. The object is a stand-in: the thesis has no formula.",
        reconstructions.draw_example_1,
    ),
    "example_2": GalleryFigure(
        _thesis(5, 15, 20),
        "24 contours at uneven heights rebuilt, corrected; another stand-in.",
        reconstructions.draw_example_2,
    ),
    "run": GalleryFigure(
        (),
        "A vase explored: finger, touched points, contours, the solid so far; grey is the truth.",
        runs.draw_run,
    ),
    "deviation": GalleryFigure(
        (),
        "A mesh explored and rebuilt, and its distance from the true surface.",
        runs.draw_deviation,
    ),
    "cost": GalleryFigure(
        (),
        "What accuracy cost the vase's run, and where the processor's time went.",
        runs.draw_cost,
    ),
}


def find_figures(words: Sequence[str]) -> list[str]:
    """Names of the figures that words name, by name or by number in the thesis; all without words.

    Raises InputError if there is no such figure.
    """
    by_number = {number: name for name, figure in FIGURES.items() for number in figure.numbers}
    for word in words:
        if word not in FIGURES and word not in by_number:
            near = "see palpate gallery --list" if word[:1].isdigit() else hint(word, FIGURES)
            raise InputError(f"there is no figure {word!r}; {near}")
    return list(dict.fromkeys(by_number.get(word, word) for word in words)) or list(FIGURES)


def write_gallery(names: Iterable[str], folder: Path, say: Callable[[str], None]) -> list[Path]:
    """Draw figures into a folder, which is made if missing; returns the files.

    `say` is called with the name of each before it is drawn. Raises InputError if a file cannot be
    written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    files = []
    for name in names:
        say(name)
        path, drawn = folder / f"{name}.png", draw_png(name)
        write_atomically({path: partial(_write, drawn)})
        files.append(path)
    return files


def _write(data: bytes, path: Path) -> None:
    path.write_bytes(data)


@style.styled
def draw_png(name: str) -> bytes:
    """One figure as the bytes of a PNG file with a palette."""
    raw = io.BytesIO()
    figure = FIGURES[name].draw()
    figure.savefig(raw, format="rgba", dpi=style.LAYOUT.dpi)
    width = round(figure.get_figwidth() * style.LAYOUT.dpi)
    picture = np.frombuffer(raw.getbuffer(), np.uint8).reshape(-1, width, 4)[..., :3]
    # Keeps rare colours, such as the end of a scale, where the usual median cut would mix them.
    palette = Image.fromarray(picture).quantize(
        256, Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
    )
    file = io.BytesIO()
    palette.save(file, "PNG", optimize=True)
    return file.getvalue()
