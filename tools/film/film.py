"""A run as a film: the finger explores, the solid grows, and error and bound fall.

Drawn without a screen, frame by frame; mp4 by ffmpeg where that is installed, else GIF.
"""

from __future__ import annotations

import math
import shutil
import subprocess
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.launch.colours import COLOURS
from palpate.launch.files.file_access import check_new, write_new
from palpate.launch.files.source_map import InputError
from palpate.launch.printing import counted
from palpate.tools.drawables import LAYERS, SCALARS, model_mesh
from palpate.tools.surfaces import VertexColours, shades, tactile_colours, vertex_colours
from palpate.tools.view.picture import draw_moment, finger_mesh
from palpate.tools.view.rasteriser import Canvas, Pixels, camera_on
from palpate.tools.view.timeline import Timeline, curve_of

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

INK, DIM, FRAME, GRID = "#1f2328", "#59636e", "#8c959f", "#e6eaef"


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmSettings:
    """Course of a film, and how much of a run its scene shows."""

    ending: float = 0.2  # fraction of the film, its last part, in which the coloured solid turns
    first_azimuth: float = -60.0  # [degrees] of the camera
    turn: float = 60.0  # [degrees] of the camera before the ending
    ending_turn: float = 150.0  # [degrees] of the camera during it
    scene_share: float = 0.62  # fraction of the width; the rest, at the right, has figures
    finger_lift: float = 0.012  # [m] off the surface, midway between two touches
    n_recent: int = 400  # latest touched points, which are drawn
    min_font: int = 8  # [pixels]


DEFAULT_FILM = FilmSettings()


class Format(NamedTuple):
    """Size and rate of a kind of film, and the function that writes it."""

    width: int
    height: int
    rate: int  # [frames/s]
    write: Callable[[Iterator[Pixels], Path, Format], None]


def make_film(
    line: Timeline, path: Path, *, seconds: float = 20.0, say: Callable[[str], None]
) -> None:
    """Write a film of a run; `say` is called with its progress.

    The suffix of `path` is ``.mp4``, which needs ffmpeg, or ``.gif``. Raises InputError if it is
    another, the file exists or cannot be written, ffmpeg is missing, or nothing was touched.
    """
    check_new(path)
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path}: must end in .mp4 or .gif, got {path.suffix or 'no suffix'!r}")
    if kind.write is _write_mp4 and shutil.which("ffmpeg") is None:
        raise InputError(f"{path}: mp4 needs ffmpeg, which is not installed; name a .gif instead")
    if not line.touches:
        raise InputError("the run has no touches: there is nothing to show")
    if not math.isfinite(seconds):
        raise InputError(f"seconds must be a finite number, got {seconds}")
    count = max(2, round(seconds * kind.rate))

    def frames() -> Iterator[Pixels]:
        said, film = -1, Film(line, kind.width, kind.height)
        for number in range(count):
            if (tenth := 10 * number // count) != said:
                said = tenth
                say(f"{10 * tenth} %")
            yield film.frame(number / (count - 1))

    write_new(path, lambda part: kind.write(frames(), part, kind))


@dataclass(slots=True)
class Film:
    """The frames of a film: the scene at the left, figures of the run at the right."""

    line: Timeline
    width: int  # [pixels]
    height: int  # [pixels]
    settings: FilmSettings = DEFAULT_FILM
    coloured: VertexColours | None = None  # of the last model

    def __post_init__(self) -> None:
        if self.line.models:
            mesh = model_mesh(self.line.models[-1], self.line.surface)
            self.coloured = vertex_colours(mesh.scalars())

    def frame(self, share: float) -> Pixels:
        """The picture (height, width, 3) at a share of the film, 0 to 1."""
        from PIL import Image, ImageDraw

        last = self.settings.ending
        exploring = min(share / (1.0 - last), 1.0)
        ending = max(0.0, (share - 1.0 + last) / last)
        time = exploring * self.line.end
        picture = np.full((self.height, self.width, 3), 255, np.uint8)
        scene_width = round(self.settings.scene_share * self.width)
        picture[:, :scene_width] = self._scene(time, exploring, ending, scene_width)
        image = Image.fromarray(picture)
        self._draw_figures(ImageDraw.Draw(image), image, time, ending, scene_width)
        return np.asarray(image)

    def _scene(self, time: float, exploring: float, ending: float, width: int) -> Pixels:
        """The scene at a robot time; `exploring` and `ending`: progress of both parts, 0 to 1."""
        line, moment, settings = self.line, self.line.at(time), self.settings
        turned = settings.first_azimuth + settings.turn * exploring
        azimuth = turned + settings.ending_turn * ending
        low, high = line.bounds()
        canvas = Canvas(width, self.height, camera_on(low, high, azimuth=azimuth))
        if ending > 0.0 and self.coloured is not None:
            draw_moment(canvas, line, moment, self.coloured.colours.astype(np.float64))
            return canvas.image()
        draw_moment(canvas, line, moment, n_recent=settings.n_recent)
        if ending == 0.0 and moment.touches:
            pose = finger_pose(line, time, settings.finger_lift)
            canvas.draw_mesh(*finger_mesh(pose), np.array(LAYERS["finger"].rgb))
        return canvas.image()

    def _draw_figures(
        self, draw: ImageDraw, image: Any, time: float, ending: float, left: int
    ) -> None:
        """Draw the tactile image, counts, and the curves of error and bound."""
        unit, right = self.height / 360.0, self.width - round(0.03 * self.width)
        moment = self.line.at(time)
        side = round(104 * unit)
        if ending > 0.0 and self.coloured is not None:
            self._draw_scale(draw, self.coloured, left, round(40 * unit), right, unit)
        elif moment.touches:
            self._draw_tactile(draw, image, moment.touches - 1, left, round(16 * unit), side)
        texts = [f"{time:.0f} s robot time", counted(moment.touches, "touch", "touches")]
        texts.append(counted(self.line.traced(moment), "contour"))
        if not moment.touches:
            contacts = sum(len(grasp.points) for grasp in self.line.grasps[: moment.grasps])
            texts[1:] = [counted(contacts, "contact"), "of the hand"]
        if ending == 0.0:
            x = left + side + 12 * unit
            font = self._fitting_font(draw, texts, right - x, round(13 * unit))
            for row, text in enumerate(texts):
                draw.text((x, (22 + 22 * row) * unit), text, INK, font)
        box = (left + 40 * unit, 160 * unit, right, 320 * unit)
        self._draw_curves(draw, time, box, unit)
        self._draw_legend(draw, left, unit, ending)

    def _draw_legend(self, draw: ImageDraw, width: int, unit: float, ending: float) -> None:
        """The colours of the scene, below it."""
        shown = ["solid", "contours", "touched", "finger"]
        if ending > 0.0:
            shown = ["contours"] if self.coloured is not None else ["solid", "contours"]
            shown += ["untouched"] * (
                self.line.done is not None and len(self.line.done.open_places) > 0
            )
        font, x, y = self._fitting_font(draw, [], width, round(11 * unit)), 12 * unit, 340 * unit
        for text, colour in ((LAYERS[name].label, LAYERS[name].colour) for name in shown):
            draw.rectangle((x, y, x + 10 * unit, y + 10 * unit), colour, FRAME)
            draw.text((x + 15 * unit, y + 5 * unit), text, INK, font, anchor="lm")
            x += 30 * unit + draw.textlength(text, font)

    def _draw_tactile(
        self, draw: ImageDraw, image: Any, touch: int, left: int, top: int, side: int
    ) -> None:
        from PIL import Image

        pressed = self.line.touches[touch].compression
        if not pressed.size:
            return
        deepest = max(float(touch.compression.max(initial=0.0)) for touch in self.line.touches)
        cells = tactile_colours(pressed, deepest or 1.0)
        image.paste(
            Image.fromarray(cells).resize((side, side), Image.Resampling.NEAREST), (left, top)
        )
        draw.text((left, top + side + 4), "compression", DIM, self._font(round(0.1 * side)))

    def _draw_scale(
        self, draw: ImageDraw, coloured: VertexColours, left: int, top: int, right: int, unit: float
    ) -> None:
        ramp = shades(np.linspace(0.0, 1.0, right - left), 1.0)
        for x, colour in enumerate(ramp.tolist(), left):
            draw.line([(x, top), (x, top + 14 * unit)], tuple(colour))
        top_text, name = f"{1e3 * coloured.top:g} mm and over", SCALARS[coloured.name]
        font = self._fitting_font(draw, [f"0  {top_text}", name], right - left, round(12 * unit))
        draw.text((left, top + 20 * unit), "0", INK, font)
        draw.text((right, top + 20 * unit), top_text, INK, font, anchor="ra")
        draw.text((left, top + 40 * unit), name, DIM, font)

    def _draw_curves(
        self, draw: ImageDraw, time: float, box: tuple[float, float, float, float], unit: float
    ) -> None:
        """Draw error and bound [mm], on a log scale, against robot time up to `time`."""
        _, times, errors, bounds = curve_of(self.line)
        known = np.concatenate([errors, bounds])
        known = known[np.isfinite(known) & (known > 0.0)]
        if not len(known):
            return
        left, top, right, bottom = box
        low, high = math.log10(known.min()) - 0.15, math.log10(known.max()) + 0.15
        font, end = self._font(round(11 * unit)), max(self.line.end, 1e-9)
        draw.rectangle(box, outline=FRAME)
        for power in range(math.ceil(low + 3.0), math.floor(high + 3.0) + 1):
            y = bottom - (power - 3.0 - low) / (high - low) * (bottom - top)
            draw.line([(left, y), (right, y)], GRID)
            draw.text((left - 5 * unit, y), f"{10.0**power:g}", DIM, font, anchor="rm")
        for values, colour in ((bounds, COLOURS["bound"]), (errors, COLOURS["error"])):
            shown = (times <= time) & np.isfinite(values) & (values > 0.0)
            across = left + times[shown] / end * (right - left)
            up = bottom - (np.log10(values[shown]) - low) / (high - low) * (bottom - top)
            points = list(zip(across.tolist(), up.tolist(), strict=True))
            if len(points) > 1:
                draw.line(points, colour, max(1, round(1.6 * unit)))
            for x, y in points:
                draw.ellipse((x - 2 * unit, y - 2 * unit, x + 2 * unit, y + 2 * unit), colour)
        now = left + min(time / end, 1.0) * (right - left)
        draw.line([(now, top), (now, bottom)], FRAME)
        words = {"error": "rms error", "bound": "error bound, mm"}
        font = self._fitting_font(
            draw, ["   ".join(words.values())], right - left, round(11 * unit)
        )
        for quantity, text in words.items():
            draw.text((left, top - 16 * unit), text, COLOURS[quantity], font)
            left += draw.textlength(f"{text}   ", font)
        text = f"robot time, to {end:.0f} s"
        draw.text((right, bottom + 4 * unit), text, DIM, font, anchor="ra")

    def _fitting_font(self, draw: ImageDraw, texts: Sequence[str], width: float, size: int) -> Any:
        """The largest font, at most of a `size` [pixels], in which all texts fit into `width`."""
        while size > self.settings.min_font and any(
            draw.textlength(text, self._font(size)) > width for text in texts
        ):
            size -= 1
        return self._font(size)

    def _font(self, size: int) -> Any:
        return _font(max(size, self.settings.min_font))


def finger_pose(line: Timeline, time: float, lift: float) -> Floats:
    """Pose (7,) of the drawn finger at a robot time, between one touch and the next.

    `lift` [m] off the surface midway between them.
    """
    following = bisect_right(line.touches, time, key=lambda touch: touch.time)
    after = line.touches[min(following, len(line.touches) - 1)]
    before = line.touches[max(following - 1, 0)]
    share = min(max((time - before.time) / max(after.time - before.time, 1e-9), 0.0), 1.0)
    turn = before.pose[3:] * np.copysign(1.0, before.pose[3:] @ after.pose[3:])
    pose = (1.0 - share) * np.append(before.pose[:3], turn) + share * after.pose
    pose[3:] /= max(float(np.linalg.norm(pose[3:])), 1e-12)
    if not np.isfinite(pose).all() or not pose[3:].any():  # the poses face each other
        return after.pose
    return Pose.from_array(pose).advanced(-lift * math.sin(math.pi * share)).array


@cache
def _font(size: int) -> Any:
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), size)


def _write_mp4(frames: Iterator[Pixels], path: Path, kind: Format) -> None:
    command = ["ffmpeg", "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]
    command += ["-s", f"{kind.width}x{kind.height}", "-r", str(kind.rate), "-i", "-"]
    command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20", "-movflags", "+faststart"]
    with subprocess.Popen(
        [*command, "-f", "mp4", str(path)], stdin=subprocess.PIPE, stderr=subprocess.PIPE
    ) as ffmpeg:
        assert ffmpeg.stdin is not None and ffmpeg.stderr is not None
        try:
            for frame in frames:
                ffmpeg.stdin.write(frame.tobytes())
            ffmpeg.stdin.close()
        except BrokenPipeError:
            pass  # ffmpeg ended; it prints why
        lines = ffmpeg.stderr.read().decode(errors="replace").strip().splitlines()
        if ffmpeg.wait() != 0:
            raise InputError(f"{path}: ffmpeg failed: {lines[-1] if lines else ''}")


def _write_gif(frames: Iterator[Pixels], path: Path, kind: Format) -> None:
    from PIL import Image

    first = Image.fromarray(next(frames)).quantize(128, dither=Image.Dither.NONE)
    rest = (Image.fromarray(frame).quantize(128, dither=Image.Dither.NONE) for frame in frames)
    first.save(path, "GIF", save_all=True, append_images=rest, duration=1000 // kind.rate, loop=0)


FORMATS = {
    ".mp4": Format(960, 540, 20, _write_mp4),
    ".gif": Format(640, 360, 10, _write_gif),
}
