"""The stages of a touch: their order, states, random draws, and what they may leave behind."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import Pose
from palpate.core.robot_time import contact_seconds
from palpate.core.touch import (
    Fingertip,
    KeyedRandom,
    Phase,
    Pipeline,
    SimulatedTouch,
    Stage,
    assemble,
    guarded_move,
)
from palpate.core.touch.effects import EFFECT_NAMES, effect_type, rank
from tests.core.touch.touches import above, finger, touch


@dataclass(frozen=True, slots=True)
class Mark:
    """An effect that notes when it acted, what it was given, and what the array read then."""

    phase: Phase
    name: str
    notes: list[Any]
    noise: float = 0.0

    def prepare(self, tip: Fingertip) -> Stage:
        def apply(contact: SimulatedTouch, state: int) -> int:
            self.notes.append((self.name, contact.reading))
            return state + 1

        return Stage(apply, state=0, noise=self.noise)


def simulated(pipeline: Pipeline, *touches: SimulatedTouch) -> SimulatedTouch:
    """The last of some touches, one after the other."""
    states = pipeline.begin()
    for contact in touches:
        states = pipeline.simulate(contact, states)
    return touches[-1]


@pytest.mark.parametrize("signal", ["time", "force"])
@pytest.mark.parametrize("options", [{}, {"reach": 1e-3}, {"depth": 2.9e-3}])
def test_ideal_touch_is_its_guarded_move(options, signal):
    tip = finger(signal, pitch=0.9e-3)
    elsewhere = Pose(np.array([0.01, 0.02, 0.04]), np.diag([1.0, -1, -1]))
    start = touch(**options)
    end = guarded_move(start.shape, tip.pad, start.actual, start.reach, start.depth)
    contact = simulated(assemble(tip, []), touch(believed=elsewhere, **options))
    assert (contact.outcome, contact.advance) == (end.outcome, end.advance)
    assert np.array_equal(contact.actual.array, end.pose.array)
    assert np.array_equal(contact.indentation, end.indentation)
    assert np.array_equal(contact.compression, end.compression)
    assert np.allclose(contact.reading, end.compression, rtol=1e-15, atol=0.0)
    assert np.allclose(contact.pressure * 0.9e-3**2, 200.0 * end.compression, rtol=1e-14)
    moved = contact.believed.position - elsewhere.position
    assert np.allclose(moved, [0, 0, -end.advance], atol=1e-16)
    assert np.array_equal(contact.believed.axes, elsewhere.axes) and contact.copies == 1


@pytest.mark.parametrize(
    ("options", "outcome", "deepest"),
    [
        ({}, "hit", 1e-3),
        ({"depth": 2.9e-3}, "bottomed", 2.4e-3),
        ({"reach": 1e-3}, "miss", 0.0),
        ({"actual": above(0.0)}, "inside", 0.0),
    ],
)
def test_times_of_a_touch_add_up_to_those_of_its_move(options, outcome, deepest):
    tip = finger()
    contact = simulated(assemble(tip, []), touch(begun=5.0, previous=4.0, **options))
    robot, met = tip.robot, deepest > 0.0
    assert contact.outcome == outcome
    assert contact.loading == pytest.approx(deepest / robot.approach)
    assert contact.dwell == (robot.dwell if met else 0.0)
    assert contact.time == 5.0 + contact_seconds(robot, contact.advance)
    before = contact.advance / robot.approach - contact.loading
    assert contact.rest == pytest.approx(1.0 + before + robot.overhead)


def test_stages_act_by_phase_then_listed_order():
    notes: list[Any] = []
    phases = [phase for phase in Phase if phase is not Phase.CAST]
    marks = [Mark(one, f"{one.name} {i}", notes) for i in (1, 2) for one in reversed(phases)]
    simulated(assemble(finger(), marks), touch())
    assert [name for name, _ in notes] == [f"{p.name} {i}" for p in phases for i in (1, 2)]


def test_states_noises_and_names_belong_to_their_stages():
    marks = [Mark(Phase.SIGNAL, "a", [], 3e-6), Mark(Phase.AIM, "b", [], 4e-6)]
    pipeline = assemble(finger(), marks)
    assert pipeline.names == ("Mark", "cast", "transducer", "Mark")
    assert pipeline.begin() == (0, None, None, 0)
    assert pipeline.simulate(touch(), (5, None, None, 8)) == (6, None, None, 9)
    assert pipeline.noise == pytest.approx(5e-6) and assemble(finger(), []).noise == 0.0


def test_one_effect_may_replace_the_cast():
    notes: list[Any] = []
    with pytest.raises(ValueError, match="no finite"):  # nothing was cast
        simulated(assemble(finger(), [Mark(Phase.CAST, "cast", notes)]), touch())
    assert [name for name, _ in notes] == ["cast"]
    with pytest.raises(ValueError, match="Mark and Mark both replace the cast"):
        assemble(finger(), [Mark(Phase.CAST, name, []) for name in "ab"])


@pytest.mark.parametrize("other", [name for name in EFFECT_NAMES if name != "gaussian_noise"])
def test_added_effect_does_not_change_the_draws_of_another(other):
    tip = finger()
    # A hit, a miss and a press to the bottom: what came of a touch changes no draw either.
    outcomes: list[dict[str, float]] = [{}, {"reach": 1e-3}, {"depth": 2.9e-3}]
    touches = [touch(number, **given) for number, given in enumerate(outcomes)]
    draws = KeyedRandom(tip, "gaussian_noise")
    expected = [draws.of_touch(number).standard_normal((16, 16)) for number in range(3)]
    before, after = list[Any](), list[Any]()
    own = [Mark(Phase.SIGNAL, "", before), effect_type("gaussian_noise")()]
    own.append(Mark(Phase.SIGNAL, "", after))
    beside, first = effect_type(other)(), rank(other) < rank("gaussian_noise")
    simulated(assemble(tip, [beside, *own] if first else [*own, beside]), *touches)
    result = [(b - a) / 10e-6 for (_, a), (_, b) in zip(before, after, strict=True)]
    # Readings are of millimetres, and the sums of them and the noise are rounded as such.
    assert np.allclose(result, expected, rtol=0.0, atol=1e-10)


@dataclass(frozen=True)
class Odd:
    """An effect that does one thing wrong."""

    wrong: str = ""
    phase: ClassVar = Phase.LINK

    def prepare(self, tip: Fingertip) -> Any:
        if self.wrong == "prepare":
            raise KeyError("gone")
        noise = float("nan") if self.wrong == "noise" else 0.0
        return None if self.wrong == "nothing" else Stage(self.apply, noise=noise)

    def apply(self, contact: SimulatedTouch, state: None) -> None:
        if self.wrong == "apply":
            raise ZeroDivisionError("boom")
        changes: dict[str, tuple[str, Any]] = {
            "nan": ("reading", np.full_like(contact.reading, np.nan)),
            "shape": ("reading", contact.reading[:4]),
            "time": ("time", -5.0),
            "forever": ("time", float("inf")),
            "none": ("copies", 0),
            "many": ("copies", 101),
        }
        if self.wrong in changes:
            setattr(contact, *changes[self.wrong])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("prepare", "the effect Odd cannot be prepared: KeyError: 'gone'"),
        ("nothing", "the effect Odd prepares a NoneType, not a Stage"),
        ("noise", "the effect Odd has a noise of nan"),
        ("apply", "the effect Odd failed: ZeroDivisionError: boom"),
        ("nan", "left a reading that is no finite"),
        ("shape", "left a reading that is no finite"),
        ("time", "left a touch that ends at -5.0 s"),
        ("forever", "left a touch that ends at inf s"),
        ("none", "is sent 0 times"),
        ("many", "is sent 101 times"),
    ],
)
def test_errors_of_effects_name_the_effect(wrong, words):
    with pytest.raises(ValueError, match=words):
        simulated(assemble(finger(), [Odd(wrong)]), touch())
    assert simulated(assemble(finger(), [Odd()]), touch()).outcome == "hit"


def test_draws_of_touch_are_repeatable_in_any_order():
    draws = KeyedRandom(finger(), "drift")
    first = draws.of_touch(5).standard_normal(100)
    once = draws.once().random(7)
    draws.of_touch(6).integers(0, 9, size=3, dtype=np.uint32)  # leaves half a word over
    assert np.array_equal(draws.of_touch(5).standard_normal(100), first)
    assert np.array_equal(draws.once().random(7), once)
    again = KeyedRandom(finger(), "drift").of_touch(5).standard_normal(100)
    assert np.array_equal(again, first)


def test_draws_of_other_keys_are_independent():
    def drawn(tip: Fingertip, name: str, number: int) -> Floats:
        return KeyedRandom(tip, name).of_touch(number).standard_normal(4096)

    others = [finger(seed=8), finger(number=2)]
    samples = [drawn(finger(), "drift", 3), *(drawn(one, "drift", 3) for one in others)]
    samples += [drawn(finger(), "gaussian_noise", 3), drawn(finger(), "drift", 4)]
    samples += [KeyedRandom(finger(), "drift").once().standard_normal(4096)]
    # The correlation of independent samples has a standard error of 1 / sqrt(n).
    correlations = np.corrcoef(samples) - np.eye(len(samples))
    assert np.abs(correlations).max() < 5 / np.sqrt(4096)
