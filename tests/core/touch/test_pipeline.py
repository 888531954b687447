from __future__ import annotations

import itertools
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.touch.draws import Draws
from palpate.core.touch.effect import Effect, Place, Stage
from palpate.core.touch.effects.catalogue import NAMES, effect_type, rank
from palpate.core.touch.pipeline import Pipeline, assemble
from palpate.core.touch.touch import Finger, Touch

MakeFinger = Callable[..., Finger]
MakeTouch = Callable[..., Touch]
Values = Callable[[Touch], dict[str, Any]]

IDEAL = """
import sys
import numpy as np
from palpate.core.frames import DOWN, pose_of
from palpate.core.measure.robot_time import PRESETS
from palpate.core.shapes.superquadric import Superquadric
from palpate.core.touch.calibration import Calibration
from palpate.core.touch.pad import Pad
from palpate.core.touch.pipeline import assemble
from palpate.core.touch.touch import Finger, Touch

pad = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
finger = Finger(pad, Calibration("time", 3e-3, 1000.0, 0.2e3), PRESETS["modern"])
pipeline, start = assemble(finger, []), pose_of(np.array([0.0, 0.0, 0.033]), DOWN)
ball = Superquadric(np.full(3, 0.03), np.ones(2))
touch = Touch(ball, 0, start, start, reach=0.01, depth=1e-3, begun=0.0, previous=0.0)
pipeline.feel(touch, pipeline.begin())
assert touch.outcome == "hit"
print(*sorted(sys.modules))
"""


@dataclass(frozen=True, slots=True)
class Mark:
    """An effect that notes when it acted."""

    place: Place
    name: str
    notes: list[str]

    def prepare(self, finger: Finger) -> Stage:
        def act(touch: Touch, state: int) -> int:
            self.notes.append(self.name)
            return state + 1

        return Stage(act, state=0)


@dataclass(frozen=True, slots=True)
class Loud:
    """An effect that a calibration would find to be noise."""

    noise: float
    place: ClassVar = Place.SIGNAL

    def prepare(self, finger: Finger) -> Stage:
        return Stage(lambda touch, state: None, noise=self.noise)


def effects_of(*names: str) -> list[Effect]:
    """The effects as a scene's are: sorted by the catalogue, whatever the order of the list."""
    return [effect_type(name)() for name in sorted(names, key=rank)]


def felt(pipeline: Pipeline, touches: list[Touch]) -> list[Touch]:
    states = pipeline.begin()
    for touch in touches:
        states = pipeline.feel(touch, states)
    return touches


def test_an_ideal_touch_imports_no_effect_and_no_random_number() -> None:
    done = subprocess.run(
        [sys.executable, "-P", "-c", IDEAL], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.split()
    assert "palpate.core.touch.pipeline" in loaded
    assert not [name for name in loaded if name.startswith("palpate.core.touch.effects")]
    assert not [name for name in loaded if name.startswith(("numpy.random", "scipy"))]
    assert "palpate.core.touch.draws" not in loaded


def test_without_effects_the_array_reads_the_compression(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    pipeline = assemble(make_finger(), [])
    (touch,) = felt(pipeline, [make_touch()])
    assert touch.outcome == "hit"
    assert np.array_equal(touch.reading, touch.compression)
    assert len(pipeline.stages) == 2


@pytest.mark.parametrize("given", [{}, {"reach": 1e-3}, {"depth": 2.9e-3}])
def test_an_array_of_forces_reads_the_compression_too_if_its_springs_are_ideal(
    given: dict[str, float], make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    (touch,) = felt(assemble(make_finger(signal="force"), []), [make_touch(**given)])
    assert np.allclose(touch.reading, touch.compression, rtol=1e-15, atol=0.0)


def test_stages_act_by_place_and_within_a_place_as_given(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    notes: list[str] = []
    marks = [Mark(place, f"{place.name} {i}", notes) for i in (1, 2) for place in reversed(Place)]
    marks = [mark for mark in marks if mark.place is not Place.CAST]
    pipeline = assemble(make_finger(), marks)  # type: ignore[arg-type]
    felt(pipeline, [make_touch()])
    assert notes == [f"{p.name} {i}" for p in Place if p is not Place.CAST for i in (1, 2)]


def test_an_effect_of_the_cast_takes_its_place(
    make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    notes: list[str] = []
    pipeline = assemble(make_finger(), [Mark(Place.CAST, "cast", notes)])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="no finite"):  # nobody has cast anything
        felt(pipeline, [make_touch()])
    assert notes == ["cast"]


def test_two_effects_of_the_cast_are_refused(make_finger: MakeFinger) -> None:
    marks = [Mark(Place.CAST, name, []) for name in "ab"]
    with pytest.raises(ValueError, match="Mark and Mark both say how a taxel sees the surface"):
        assemble(make_finger(), marks)  # type: ignore[arg-type]


def test_each_stage_is_given_its_own_state(make_finger: MakeFinger, make_touch: MakeTouch) -> None:
    marks = [Mark(Place.SIGNAL, "a", []), Mark(Place.AIM, "b", [])]
    pipeline = assemble(make_finger(), marks)  # type: ignore[arg-type]
    assert pipeline.begin() == (0, None, None, 0)
    after = pipeline.feel(make_touch(), (5, None, None, 8))
    assert after == (6, None, None, 9)


def test_noises_of_the_stages_add_as_squares(make_finger: MakeFinger) -> None:
    assert assemble(make_finger(), []).noise == 0.0
    assert assemble(make_finger(), [Loud(3e-6), Loud(4e-6)]).noise == pytest.approx(5e-6)


def test_the_order_of_a_list_does_not_matter(
    make_finger: MakeFinger, make_touch: MakeTouch, values_of: Values
) -> None:
    names = ("quantisation", "gaussian_noise", "arm_backlash", "pose_error")
    found = []
    for order in itertools.permutations(names):
        touches = [make_touch(number) for number in range(3)]
        felt(assemble(make_finger(), effects_of(*order)), touches)
        found.append([values_of(touch) for touch in touches])
    assert all(values == found[0] for values in found)


@dataclass(frozen=True, slots=True)
class Probe:
    """Keeps the readings that pass it."""

    kept: list[Floats]
    place: ClassVar = Place.SIGNAL

    def prepare(self, finger: Finger) -> Stage:
        return Stage(lambda touch, state: self.kept.append(touch.reading))


def noise_beside(other: str, finger: Finger, touches: list[Touch]) -> Floats:
    """What the Gaussian noise adds to each reading, in a pipeline that has another effect too."""
    before, after = Probe([]), Probe([])
    noise, others = effects_of("gaussian_noise"), effects_of(other)
    probed = [before, *noise, after]
    first = rank(other) < rank("gaussian_noise")
    felt(assemble(finger, [*others, *probed] if first else [*probed, *others]), touches)
    return np.subtract(after.kept, before.kept)


@pytest.mark.parametrize("other", [name for name in NAMES if name != "gaussian_noise"])
def test_an_effect_that_is_added_does_not_change_the_draws_of_another(
    other: str, make_finger: MakeFinger, make_touch: MakeTouch
) -> None:
    finger = make_finger()
    # A hit, a miss and a press to the bottom: what came of a touch changes no draw either.
    outcomes: list[dict[str, float]] = [{}, {"reach": 1e-3}, {"depth": 2.9e-3}]
    touches = [make_touch(number, **given) for number, given in enumerate(outcomes)]
    draws = Draws(finger, "gaussian_noise")
    expected = [draws.of_touch(number).standard_normal((16, 16)) for number in range(3)]
    found = noise_beside(other, finger, touches) / 10e-6
    # Readings are of millimetres, and the sums of them and the noise are rounded as such.
    assert np.allclose(found, expected, rtol=0.0, atol=1e-10)


@dataclass(frozen=True)
class Odd:
    """An effect that does one thing wrong."""

    wrong: str = ""
    place: ClassVar = Place.LINK

    def prepare(self, finger: Finger) -> Any:
        if self.wrong == "prepare":
            raise KeyError("gone")
        if self.wrong == "nothing":
            return None
        return Stage(self.act, noise=float("nan") if self.wrong == "noise" else 0.0)

    def act(self, touch: Touch, state: None) -> None:
        if self.wrong == "act":
            raise ZeroDivisionError("boom")
        if self.wrong == "nan":
            touch.reading = np.full_like(touch.reading, np.nan)
        if self.wrong == "shape":
            touch.reading = touch.reading[:4]
        if self.wrong == "time":
            touch.time = -5.0
        if self.wrong == "copies":
            touch.copies = 0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("prepare", "the effect Odd cannot be prepared: KeyError: 'gone'"),
        ("nothing", "the effect Odd prepares a NoneType, not a Stage"),
        ("noise", "the effect Odd has a noise of nan"),
    ],
)
def test_an_effect_that_cannot_be_prepared_is_named(
    wrong: str, words: str, make_finger: Callable[..., Finger]
) -> None:
    with pytest.raises(ValueError, match=words):
        assemble(make_finger(), [Odd(wrong)])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("act", "the effect Odd failed: ZeroDivisionError: boom"),
        ("nan", "left a reading that is no finite"),
        ("shape", "left a reading that is no finite"),
        ("time", "left a touch that ends at -5.0 s"),
        ("copies", "is sent 0 times"),
    ],
)
def test_what_an_effect_leaves_is_checked(
    wrong: str,
    words: str,
    make_finger: Callable[..., Finger],
    make_touch: Callable[..., Touch],
) -> None:
    pipeline = assemble(make_finger(), [Odd(wrong)])
    with pytest.raises(ValueError, match=words):
        pipeline.feel(make_touch(), pipeline.begin())


def test_every_stage_has_a_name(make_finger: Callable[..., Finger]) -> None:
    assert assemble(make_finger(), [Odd()]).names == ("cast", "transducer", "Odd")
