"""Pads, fingers, touches that have come as far as a test wants them, and random ones by kind."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from palpate.core.arrays import Bools, Floats
from palpate.core.poses import FACING_DOWN, Pose
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.shapes import Superquadric
from palpate.core.touch import Calibration, Fingertip, Pad, PatchKind, SimulatedTouch, Stage
from palpate.core.touch.effects import effect_type

FLAT = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
DOMED = replace(FLAT, dome=1.0 / 0.015)
X, Y = FLAT.grid()
BALL = Superquadric(np.full(3, 0.03), np.ones(2))
SOUND_SPEED, TAXEL_STIFFNESS = 1000.0, 200.0  # [m/s], [N/m]
# Compression of a flat pad under a ball of 30 mm, 1 mm deep, not quite in the middle.
DENT: Floats = np.maximum(1e-3 - ((X - 0.7e-3) ** 2 + (Y + 0.4e-3) ** 2) / 0.06, 0.0)
DENT.setflags(write=False)


def above(height: float, x: float = 0.0) -> Pose:
    """Pose of a pad that looks down from a height [m]."""
    return Pose(np.array([x, 0.0, height]), FACING_DOWN)


def finger(signal: Any = "time", seed: int = 7, number: int = 1, **pad: Any) -> Fingertip:
    """A modern finger; a flat pad of 16 by 16 taxels unless the fields of the pad differ."""
    made = replace(FLAT, **pad)
    sheet = Calibration(signal, made.thickness, SOUND_SPEED, TAXEL_STIFFNESS)
    return Fingertip(made, sheet, ROBOT_PRESETS["modern"], number, seed)


def touch(number: int = 0, field: Floats | None = None, **more: Any) -> SimulatedTouch:
    """A touch of a ball from 3 mm above it, with read-only arrays.

    `field` (rows, cols): compression [m] with which the move has ended in a hit.
    """
    start = above(0.033)
    options = {"shape": BALL, "believed": start, "actual": start, "reach": 0.01, "depth": 1e-3}
    options |= {"begun": float(number), "previous": float(number)}
    if field is not None:
        options |= {"indentation": field, "compression": field, "reading": field}
        options |= {"pressure": 2e8 * field, "outcome": "hit", "time": number + 1.0}
    options |= more
    for value in options.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return SimulatedTouch(number=number, **options)


def stage(name: str, tip: Fingertip | None = None, **parameters: Any) -> Stage:
    """The stage of an effect."""
    return effect_type(name)(**parameters).prepare(tip or finger())


def applied(
    name: str, to: SimulatedTouch, tip: Fingertip | None = None, **parameters: Any
) -> SimulatedTouch:
    """The touch after an effect in its first state."""
    made = stage(name, tip, **parameters)
    made.apply(to, made.state)
    return to


def readings(made: Stage, field: Floats, count: int, times: Floats | None = None) -> Floats:
    """What a stage makes of the same field in each of many touches, (count, rows, cols)."""
    state, result = made.state, []
    for number in range(count):
        contact = touch(number, field, time=number + 1.0 if times is None else times[number])
        state = made.apply(contact, state)
        result.append(contact.reading)
    return np.array(result)


def values(contact: SimulatedTouch) -> dict[str, Any]:
    """All that a touch holds, with arrays as bytes, so that touches can be compared."""
    held = {field.name: getattr(contact, field.name) for field in fields(contact)}
    arrays = {k: v.array if isinstance(v, Pose) else v for k, v in held.items()}
    return {k: v.tobytes() if isinstance(v, np.ndarray) else v for k, v in arrays.items()}


# Heights over a pad, in units of its pitch, by places u, v, a slope s and a side (1 or -1).
SURFACES = {
    "ball": lambda u, v, s, side: 12 / s - np.sqrt(144 / s**2 - u**2 - v**2),
    "cylinder": lambda u, v, s, side: 12 / s - np.sqrt(144 / s**2 - u**2) + 0.1 * s * v,
    "saddle": lambda u, v, s, side: 0.02 * (u**2 - s * v**2),
    "plane": lambda u, v, s, side: 0.2 * s * u,
    "edge": lambda u, v, s, side: side * s * np.abs(u) + 0.15 * v,
    "step": lambda u, v, s, side: 0.1 * v + 0.8 * s * (u > 0.0),
    "rim": lambda u, v, s, side: np.maximum(s * u, 30 - np.sqrt(900 - v**2) - s * u),
    "corner": lambda u, v, s, side: side * s * np.maximum(u, np.abs(0.9 * v) - 0.5 * u),
    "pyramid": lambda u, v, s, side: s * np.maximum(np.abs(u), np.abs(v)),
}
KINDS: dict[str, PatchKind] = dict.fromkeys(SURFACES, "smooth")
KINDS |= {"edge": "edge", "step": "edge", "rim": "edge", "corner": "corner", "pyramid": "corner"}


def draw_touch(rng: np.random.Generator, name: str) -> tuple[Pad, Floats, Bools, float]:
    """One touch of a surface, turned, with its feature within two pitches of the pad's middle.

    Pad, compression and touched taxels (rows, cols), and the standard deviation of one taxel [m].
    It is pressed so deep that each face owns enough taxels.
    """
    pad = FLAT if rng.random() < 0.5 else replace(FLAT, dome=1.0 / rng.uniform(12e-3, 25e-3))
    turn, steep, side = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.8), rng.choice([-1.0, 1.0])
    x, y = X / pad.pitch - rng.uniform(-2, 2), Y / pad.pitch - rng.uniform(-2, 2)
    u, v = np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x
    over = pad.pitch * SURFACES[name](u, v, steep, side) + pad.sag()
    noise = 10.0 ** rng.uniform(-6.0, -4.7)
    depth = np.quantile(over, rng.uniform(0.5, 1.0)) - over.min()
    compression = np.maximum(over.min() + depth - over, 0.0) + noise * rng.normal(size=X.shape)
    touched = compression > max(50e-6, 5.0 * noise)
    return pad, compression, touched, noise
