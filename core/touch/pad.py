"""The fingertip's pad: the guarded move, where it is in contact, and what its taxels send.

The pad's own frame: x along the columns, y along the rows, z into the object; the middle of the
undeformed face is the origin. The transducers lie one thickness behind the face and follow its
dome, so that every taxel is equally thick. A taxel sends a time of flight or a force: Fung, 1999,
(1.1), (1.2) and section 3.4.1. An elastic face is drawn down beside a contact, so that taxels there
read compression without being touched: contact is where there is load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Literal, NamedTuple

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import Pose
from palpate.core.shapes import Shape
from palpate.reprs import readable

TouchOutcome = Literal["hit", "miss", "inside", "bottomed"]
HITS = ("hit", "bottomed")  # Outcomes that locate the surface
# Shape of the face beside a contact: undeformed (springs), or sloping back like a membrane on
# springs, or like the surface of a deep elastic body.
FaceKind = Literal["springs", "membrane", "half_space"]
Signal = Literal["time", "force"]  # An array sends echoes' times of flight [s] or forces [N]
# [times of flight of the undeformed pad]; a longer median shows that times are not in seconds.
MAX_ECHO_RATIO = 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactSettings:
    """Compression from which a taxel counts as touched: the larger of both.

    At 3 sigmas one of a thousand untouched taxels would add a point where there is no surface.
    """

    min_compression: float = 50e-6  # [m]
    min_sigmas: float = 5.0  # [standard deviations of a taxel's noise]


DEFAULT_CONTACT = ContactSettings()


class FaceModel(NamedTuple):
    """Deformation of the pad's face beside a contact."""

    kind: FaceKind
    decay: float = 0.0  # [m] length in which a membrane falls to 1/e; 0 for the others


SPRINGS = FaceModel("springs")  # Each taxel is a spring of its own (Winkler)


@dataclass(frozen=True, slots=True)
class Pad:
    """Array and pad."""

    rows: int  # of taxels
    cols: int  # of taxels
    pitch: float  # [m] distance between neighbouring taxels
    thickness: float  # [m] over the transducers
    dome: float  # [1/m] curvature of the face at its middle; 0 for a flat pad
    saturation: float  # largest compression, fraction of the thickness
    face: FaceModel = SPRINGS  # as in the data sheet

    @cache  # noqa: B019 - pads are values, and few
    def grid(self) -> tuple[Floats, Floats]:
        """Coordinates x and y of the taxels, (rows, cols) each [m]; read-only."""
        x = (np.arange(self.cols) - (self.cols - 1) / 2) * self.pitch
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.pitch
        x, y = np.meshgrid(x, y)
        return _read_only(x), _read_only(y)

    @cache  # noqa: B019
    def sag(self) -> Floats:
        """Depth of the domed face below its middle, (rows, cols) [m]; read-only."""
        x, y = self.grid()
        return _read_only(0.5 * self.dome * (x * x + y * y))

    def surface(self, compression: Floats, touched: Bools) -> Floats:
        """Height of the touched surface over the face's plane, else 0, (rows, cols) [m]."""
        return np.where(touched, -(compression + self.sag()), 0.0)

    def surface_point(self, surface: Floats, taxel: int) -> Floats:
        """Point (3,) [m] of such a surface over a taxel, counted row by row."""
        x, y = self.grid()
        return np.array([x.flat[taxel], y.flat[taxel], surface.flat[taxel]])

    @cache  # noqa: B019
    def transducers(self) -> Floats:
        """Positions of the transducers in the pad's frame, (rows * cols, 3) [m]; read-only."""
        x, y = self.grid()
        z = -(self.thickness + self.sag())
        return _read_only(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))


def _read_only(array: Floats) -> Floats:
    array.setflags(write=False)
    return array


class GuardedMove(NamedTuple):
    """Result of a guarded move."""

    outcome: TouchOutcome  # as in a tactile frame
    pose: Pose  # of the pad at the end
    compression: Floats  # of the pad, (rows, cols) [m]
    advance: float  # [m] distance travelled
    # Depth of the rigid surface in the undeformed pad, (rows, cols) [m]: negative over a gap, -inf
    # where there is no surface.
    indentation: Floats


def guarded_move(shape: Shape, pad: Pad, start: Pose, reach: float, depth: float) -> GuardedMove:
    """Move a pad along its normal until its deepest compression is `depth` [m].

    A pad that saturates earlier bottoms out there and stops. `start`: pose from which it moves.
    `reach`: longest distance to first contact [m]. One ray cast serves the whole move: it gives the
    surface's distance from every taxel. Each taxel is a spring (Winkler); inside the contact the
    pad takes the surface's shape, which is exact under any elastic model.
    """
    position, axes = start
    rays = pad.transducers() @ axes.T + position
    ranges = shape.cast(rays, axes[:, 2], pad.thickness + reach + depth)
    gaps = ranges.reshape(pad.rows, pad.cols) - pad.thickness
    nearest = float(gaps.min())
    if nearest < 0.0:
        return started_inside(pad, start)
    limit = pad.saturation * pad.thickness
    advance = nearest + min(depth, limit) if nearest <= reach else reach
    indentation = advance - gaps
    outcome: TouchOutcome = "miss" if nearest > reach else "hit" if depth <= limit else "bottomed"
    return GuardedMove(
        outcome, start.advanced(advance), np.maximum(indentation, 0.0), advance, indentation
    )


def started_inside(pad: Pad, start: Pose) -> GuardedMove:
    """The result of a move that begins inside the object: no contact counts."""
    size = (pad.rows, pad.cols)
    return GuardedMove("inside", start, np.zeros(size), 0.0, np.full(size, -np.inf))


def contact_mask(
    pad: Pad,
    compression: Floats,
    contact: float,
    noise: float,
    min_sigmas: float = DEFAULT_CONTACT.min_sigmas,
) -> Bools:
    """Taxels under load, (rows, cols).

    `compression` (rows, cols) [m]. `contact`: least compression that counts [m]; also as the load
    of a pad that is pressed evenly. `noise`: standard deviation of one taxel [m]. `min_sigmas`:
    least compression in these. On a bed of springs load and compression are equal. A membrane on
    springs is loaded with ``u - decay^2 lap(u)``, taken at the pitch with free borders. On a
    half-space the load is the inverse of Love's displacements; those of a 16 by 16 array have a
    condition of 27. A contact that extends beyond the array presses from outside as well, and adds
    load at the border, which is in contact anyway. The operator magnifies noise: a face that is
    stiff over many taxels needs a quiet array.
    """
    moved = compression > max(contact, min_sigmas * noise)
    if pad.face.kind == "springs" or not moved.any():
        return moved
    if pad.face.kind == "membrane":
        share = (pad.face.decay / pad.pitch) ** 2
        load = compression - share * _laplacian(compression)
        even_load, noise_gain = 1.0, math.hypot(1.0 + 4.0 * share, 2.0 * share)
    else:
        operator, even_load, noise_gain = _half_space_loads(replace(pad, face=SPRINGS))
        load = (operator @ compression.ravel()).reshape(compression.shape)
    result: Bools = moved & (load > max(contact * even_load, min_sigmas * noise * noise_gain))
    return result


def _laplacian(image: Floats) -> Floats:
    """Sum of the four neighbours' differences; level at the borders."""
    result = np.zeros_like(image)
    down, across = np.diff(image, axis=0), np.diff(image, axis=1)
    result[:-1] += down
    result[1:] -= down
    result[:, :-1] += across
    result[:, 1:] -= across
    return result


@lru_cache(maxsize=4)  # operators of large arrays take up to 134 MB each
def _half_space_loads(pad: Pad) -> tuple[Floats, float, float]:
    """Operator from the face's shape to its load, (n, n).

    With the least load of an evenly pressed face, and the factor that magnifies noise.
    """
    kernel = half_space_influence(pad)
    loads = np.linalg.inv(kernel / kernel[0, 0])
    return (
        _read_only(loads),
        float(loads.sum(axis=1).min()),
        float(np.sqrt((loads**2).sum(axis=1)).max()),
    )


def half_space_influence(pad: Pad) -> Floats:
    """Displacement of each taxel's middle under unit pressure on another, (n, n) [m].

    The factor ``(1 - nu^2) / (pi E)`` is left out. Love, *The stress produced in a semi-infinite
    solid by pressure on part of the boundary*, 1929; Johnson, *Contact mechanics*, 1985, 3.3.
    """
    x = pad.pitch * np.arange(pad.cols, dtype=np.float64)[None, :]
    y = pad.pitch * np.arange(pad.rows, dtype=np.float64)[:, None]
    half = 0.5 * pad.pitch

    def corner(x: Floats, y: Floats) -> Floats:
        part: Floats = x * np.arcsinh(y / np.abs(x)) + y * np.arcsinh(x / np.abs(y))
        return part

    table = corner(x + half, y + half) - corner(x - half, y + half)
    table += corner(x - half, y - half) - corner(x + half, y - half)
    row, col = np.divmod(np.arange(pad.rows * pad.cols), pad.cols)
    kernel: Floats = table[np.abs(row[:, None] - row), np.abs(col[:, None] - col)]
    return kernel


@readable
@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Conversion between an array's signal and the compression of its pad."""

    signal: Signal
    thickness: float  # [m] of the undeformed pad
    sound_speed: float  # [m/s] in the pad
    taxel_stiffness: float  # [N/m] force on one taxel per compression: k of (1.2)
    gain: Floats | float = 1.0  # corrects each taxel, (rows, cols) or a scalar
    offset: Floats | float = 0.0  # [m] added after the gain, (rows, cols) or a scalar

    def encode(self, reading: Floats) -> Floats:
        """Signal that the array sends for a reading of compression [m].

        The echo's round trip through the compressed pad, ``2 (d1 - c) / v`` [s], or the force, ``k
        c`` [N]. Gain and offset are corrections of the decoder: not applied.
        """
        if self.signal == "force":
            return self.taxel_stiffness * reading
        return (self.thickness - reading) * (2.0 / self.sound_speed)

    def decode(self, array: Floats) -> Floats:
        """Compression [m] of each taxel of a frame [s] or [N], corrected by gain and offset.

        With times of flight this is (1.1), whose reference t1 is that of the undeformed pad. Raises
        ValueError if the frame has another shape than the calibration, or its median time is too
        long to be in seconds.
        """
        for correction in (self.gain, self.offset):
            shape = np.shape(correction)
            if shape not in ((), array.shape):
                raise ValueError(f"a frame must have shape {shape}, got {array.shape}")
        if self.signal == "force":
            raw = array / self.taxel_stiffness
        else:
            whole = 2.0 * self.thickness / self.sound_speed
            typical = float(np.median(np.abs(array)))
            if typical > MAX_ECHO_RATIO * whole:
                raise ValueError(
                    f"times of flight are {typical:.3g} s, through a pad that takes {whole:.3g} s: "
                    "times are in seconds; multiply microseconds by 1e-6"
                )
            raw = self.thickness - (0.5 * self.sound_speed) * array
        corrected: Floats = np.multiply(raw, self.gain) + self.offset
        return corrected
