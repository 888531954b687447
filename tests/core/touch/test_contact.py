from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.touch.contact import touched
from palpate.core.touch.effects.half_space import HalfSpace
from palpate.core.touch.effects.tenting import Tenting
from palpate.core.touch.pad import Face, Pad
from palpate.core.touch.touch import Finger, Touch

MakeFinger = Callable[..., Finger]
MakeTouch = Callable[..., Touch]

LEAST = 50e-6
SURFACES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "ball": lambda x, y: 1e-3 - (x * x + y * y) / 0.04,
    "cylinder": lambda x, y: 1e-3 - (0.6 * x + 0.8 * y) ** 2 / 0.04,
    "ridge": lambda x, y: 1e-3 - np.abs(x + 0.2e-3),
    "corner": lambda x, y: 1.5e-3 - np.maximum(np.abs(x), np.abs(y + 0.3e-3)),
    "two balls": lambda x, y: 0.8e-3 - ((np.abs(x) - 4e-3) ** 2 + y * y) / 0.01,
}


def pressed(
    effect: HalfSpace | Tenting, finger: Finger, make_touch: MakeTouch, surface: str
) -> tuple[Pad, Floats, Bools]:
    """The pad as a listener knows it, what it reads, and where it is really touched."""
    field = SURFACES[surface](*finger.pad.grid())
    springs = np.maximum(field, 0.0)
    touch = make_touch(field=field, compression=springs, pressure=2e8 * springs)
    stage = effect.prepare(finger)
    stage.act(touch, stage.state)
    assert stage.face is not None
    return replace(finger.pad, face=stage.face), touch.compression, touch.pressure > 0.0


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("effect", [HalfSpace(), Tenting(), Tenting(decay=2e-3)], ids=repr)
def test_the_skirt_about_a_contact_is_not_a_contact(
    effect: HalfSpace | Tenting, surface: str, make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    pad, reading, truly = pressed(effect, make_finger(), make_touch, surface)
    found = touched(pad, reading, LEAST, 0.0)
    assert ((reading > LEAST) & ~truly).sum() > 5  # there is a skirt to be taken in by
    assert not (found & ~truly).any()
    # A taxel at the rim that the surface touches without pressing it is given up: of the two
    # rows on a ridge's back the deeper one carries a stiff skin alone.
    least = 0.5 if surface == "ridge" else 0.6
    assert found.sum() >= least * (truly & (reading > LEAST)).sum()
    assert found[np.unravel_index(reading.argmax(), reading.shape)]


def test_on_springs_what_is_compressed_is_touched(make_finger: MakeFinger) -> None:
    pad = make_finger().pad
    reading = SURFACES["ball"](*pad.grid())
    assert np.array_equal(touched(pad, reading, LEAST, 0.0), reading > LEAST)


@pytest.mark.parametrize("face", [Face("membrane", 1e-3), Face("half_space")])
def test_noise_over_nothing_is_not_a_contact(face: Face, make_finger: MakeFinger) -> None:
    pad = replace(make_finger().pad, face=face)
    rng = np.random.default_rng(0)
    noise = 10e-6 * rng.standard_normal((200, pad.rows, pad.cols))
    assert not any(touched(pad, frame, LEAST, 10e-6).any() for frame in noise)


@pytest.mark.parametrize("face", [Face("membrane", 1e-3), Face("half_space")])
def test_noise_beside_a_contact_is_not_a_contact(
    face: Face, make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    effect = HalfSpace() if face.kind == "half_space" else Tenting()
    pad, reading, truly = pressed(effect, make_finger(), make_touch, "ball")
    rng = np.random.default_rng(1)
    for _ in range(50):
        found = touched(pad, reading + 10e-6 * rng.standard_normal(reading.shape), LEAST, 10e-6)
        assert not (found & ~truly).any()
        assert found.sum() >= 0.6 * truly.sum()
