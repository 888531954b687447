"""The fingertip's pad: the guarded move, where it is in contact, and what its taxels send.

The pad's own frame: x along the columns, y along the rows, z into the object; the middle of the
undeformed face is the origin. The transducers lie one thickness behind the face and follow its
dome, so that every taxel is equally thick. A taxel sends a time of flight or a force: Fung, 1999,
(1.1), (1.2) and section 3.4.1. An elastic face is drawn down beside a contact, so that a taxel
reads compression although nothing touches it: contact is where there is load.
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
HITS = ("hit", "bottomed")  # Outcomes that tell where the surface is
# What the face does beside a contact: nothing, or it slopes back like a membrane on springs, or
# like the surface of a deep elastic body.
FaceKind = Literal["springs", "membrane", "half_space"]
CONTACT = 50e-6  # Least compression that counts as touched, m
# A taxel counts as touched from 5 standard deviations of its noise on: at 3, one in a thousand
# untouched ones would put a point where there is no surface.
CONTACT_DEVIATIONS = 5.0
MAX_ECHO_RATIO = 1e3  # Times that of an undeformed pad: later ones are of another unit
KEPT_OPERATORS = 4  # Of large arrays each takes up to 134 MB
Signal = Literal["time", "force"]  # What an array sends: times of flight of echoes, s, or forces, N


class FaceModel(NamedTuple):
    """How the pad's face yields beside a contact."""

    kind: FaceKind  # In which way
    decay: float = 0.0  # Length in which a membrane falls to 1/e, m; 0 for the others


SPRINGS = FaceModel("springs")  # Each taxel is a spring of its own (Winkler)


@dataclass(frozen=True, slots=True)
class Pad:
    """Array and pad."""

    rows: int  # Rows of taxels
    cols: int  # Columns of taxels
    pitch: float  # Distance between neighbouring taxels, m
    thickness: float  # Thickness over the transducers, m
    dome: float  # Curvature of the face at its middle, 1/m; 0 for a flat pad
    saturation: float  # Largest compression, as a share of the thickness
    face: FaceModel = SPRINGS  # How the face yields beside a contact, as a data sheet has it

    @cache  # noqa: B019 - pads are values, and few
    def grid(self) -> tuple[Floats, Floats]:
        """Coordinates x and y of the taxels, (rows, cols) each, m; read-only."""
        x = (np.arange(self.cols) - (self.cols - 1) / 2) * self.pitch
        y = (np.arange(self.rows) - (self.rows - 1) / 2) * self.pitch
        x, y = np.meshgrid(x, y)
        return _read_only(x), _read_only(y)

    @cache  # noqa: B019
    def sag(self) -> Floats:
        """How far the domed face falls back behind its middle, (rows, cols), m; read-only."""
        x, y = self.grid()
        return _read_only(0.5 * self.dome * (x * x + y * y))

    def surface(self, compression: Floats, touched: Bools) -> Floats:
        """Surface over the plane of the face where the pad touches it, else 0, (rows, cols), m."""
        return np.where(touched, -(compression + self.sag()), 0.0)

    def surface_point(self, surface: Floats, taxel: int) -> Floats:
        """The point (3,) of such a surface over a taxel, counted row by row, m."""
        x, y = self.grid()
        return np.array([x.flat[taxel], y.flat[taxel], surface.flat[taxel]])

    @cache  # noqa: B019
    def transducers(self) -> Floats:
        """Where the transducers are in the pad's frame, (rows * cols, 3), m; read-only."""
        x, y = self.grid()
        z = -(self.thickness + self.sag())
        return _read_only(np.column_stack([x.ravel(), y.ravel(), z.ravel()]))


def _read_only(array: Floats) -> Floats:
    array.setflags(write=False)
    return array


class GuardedMove(NamedTuple):
    """How a guarded move ended."""

    outcome: TouchOutcome  # As in a tactile frame
    pose: Pose  # Of the pad at its end
    compression: Floats  # Compression of the pad, (rows, cols), m
    advance: float  # Way travelled, m
    # How far the rigid surface would enter the undeformed pad, (rows, cols), m: negative over a
    # gap, -inf where there is nothing.
    indentation: Floats


def guarded_move(shape: Shape, pad: Pad, start: Pose, reach: float, depth: float) -> GuardedMove:
    """Move a pad along its normal until its deepest compression is `depth`, m.

    A pad that saturates before bottoms out there, and goes no farther. `start`: pose from
    which it moves. `reach`: longest way to first contact, m. One cast serves the whole move: the
    surface's distance from every taxel is known at once. Each taxel is a spring (Winkler); inside
    the contact the pad takes the surface's shape, which is exact under any elastic model.
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
    """The pad began inside the object: nothing was touched that means anything."""
    size = (pad.rows, pad.cols)
    return GuardedMove("inside", start, np.zeros(size), 0.0, np.full(size, -np.inf))


def contact_mask(pad: Pad, compression: Floats, contact: float, noise: float) -> Bools:
    """Taxels under load, (rows, cols).

    `compression` (rows, cols): m. `contact`: least compression that counts, m; also as the load of
    a pad that is pressed evenly. `noise`: standard deviation of one taxel, m. On a bed of springs
    load and compression are one. A membrane on springs is loaded with ``u - decay^2 lap(u)``, taken
    at the pitch with free borders. On a half-space the load is the inverse of Love's displacements;
    those of a 16 by 16 array have a condition of 27. A contact that runs off the array presses from
    outside as well, and adds load at the border, where it is a contact anyway. Noise counts as the
    operator magnifies it: a face that is stiff over many taxels needs a quiet array.
    """
    moved = compression > max(contact, CONTACT_DEVIATIONS * noise)
    if pad.face.kind == "springs" or not moved.any():
        return moved
    if pad.face.kind == "membrane":
        share = (pad.face.decay / pad.pitch) ** 2
        load = compression - share * _laplacian(compression)
        even, magnified = 1.0, math.hypot(1.0 + 4.0 * share, 2.0 * share)
    else:
        operator, even, magnified = _half_space_loads(replace(pad, face=SPRINGS))
        load = (operator @ compression.ravel()).reshape(compression.shape)
    result: Bools = moved & (load > max(contact * even, CONTACT_DEVIATIONS * noise * magnified))
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


@lru_cache(maxsize=KEPT_OPERATORS)
def _half_space_loads(pad: Pad) -> tuple[Floats, float, float]:
    """Operator from the face's shape to its load, (n, n), and what it does to extremes.

    These are the least load of an even shape, and the factor by which noise is magnified.
    """
    kernel = half_space_influence(pad)
    loads = np.linalg.inv(kernel / kernel[0, 0])
    return (
        _read_only(loads),
        float(loads.sum(axis=1).min()),
        float(np.sqrt((loads**2).sum(axis=1)).max()),
    )


def half_space_influence(pad: Pad) -> Floats:
    """Displacement of each taxel's middle under unit pressure on another, (n, n), m.

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
    """How an array's signal is turned into compression of its pad, and back."""

    signal: Signal  # What a taxel sends
    thickness: float  # Of the undeformed pad, m
    sound_speed: float  # In the pad, m/s
    taxel_stiffness: float  # Force on one taxel for each metre of compression, N/m: k of (1.2)
    gain: Floats | float = 1.0  # Factor that corrects each taxel, (rows, cols) or one for all
    offset: Floats | float = 0.0  # Added to each taxel after that, m, (rows, cols) or one for all

    def encode(self, reading: Floats) -> Floats:
        """What the array sends for a compression that it takes to be `reading`, m.

        A round trip of the echo through the compressed pad, ``2 (d1 - c) / v`` in s, or a force,
        ``k c`` in N. Gain and offset are corrections of the decoder: not applied.
        """
        if self.signal == "force":
            return self.taxel_stiffness * reading
        return (self.thickness - reading) * (2.0 / self.sound_speed)

    def decode(self, array: Floats) -> Floats:
        """Compression, m, of each taxel of a frame in s or N; corrected by gain and offset.

        With times of flight this is (1.1), whose reference t1 is that of the undeformed pad. Raises
        ValueError where it is no frame of the calibrated array, or most taxels take so long that
        they are not in seconds.
        """
        for known in (self.gain, self.offset):
            if np.shape(known) not in ((), array.shape):
                raise ValueError(f"a frame must have shape {np.shape(known)}, got {array.shape}")
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
