import itertools
import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from palpate.core.arrays import Floats
from palpate.core.poses import FACING_DOWN, compose_poses, pose_of
from palpate.core.robot_time import contact_seconds
from palpate.core.touch.effects.catalogue import EFFECT_NAMES, effect_type, rank
from palpate.core.touch.pad import guarded_move
from palpate.core.touch.pipeline import (
    KeyedRandom,
    Phase,
    Stage,
    advanced_pose,
    assemble,
    cast_single_rays,
)

IDEAL = """
import sys
import numpy as np
from palpate.core.poses import FACING_DOWN, pose_of
from palpate.core.robot_time import ROBOT_PRESETS
from palpate.core.shapes.superquadrics import Superquadric
from palpate.core.touch.pad import Calibration, Pad
from palpate.core.touch.pipeline import assemble
from palpate.core.touch.pipeline import Fingertip, SimulatedTouch

pad = Pad(rows=16, cols=16, pitch=1e-3, thickness=3e-3, dome=0.0, saturation=0.8)
finger = Fingertip(pad, Calibration("time", 3e-3, 1000.0, 0.2e3), ROBOT_PRESETS["modern"])
pipeline, start = assemble(finger, []), pose_of(np.array([0.0, 0.0, 0.033]), FACING_DOWN)
ball = Superquadric(np.full(3, 0.03), np.ones(2))
touch = SimulatedTouch(ball, 0, start, start, reach=0.01, depth=1e-3, begun=0.0, previous=0.0)
pipeline.simulate(touch, pipeline.begin())
assert touch.outcome == "hit"
print(*sorted(sys.modules))
"""


@dataclass(frozen=True, slots=True)
class Mark:
    """An effect that notes when it acted."""

    phase: Phase
    name: str
    notes: list[str]

    def prepare(self, finger):
        def apply(touch, state):
            self.notes.append(self.name)
            return state + 1

        return Stage(apply, state=0)


@dataclass(frozen=True, slots=True)
class Loud:
    """An effect that a calibration would find to be noise."""

    noise: float
    phase: ClassVar = Phase.SIGNAL

    def prepare(self, finger):
        return Stage(lambda touch, state: None, noise=self.noise)


def effects_of(*names):
    """The effects as a scene's are: sorted by the catalogue, whatever the order of the list."""
    return [effect_type(name)() for name in sorted(names, key=rank)]


def measured(pipeline, touches):
    states = pipeline.begin()
    for touch in touches:
        states = pipeline.simulate(touch, states)
    return touches


def test_an_ideal_touch_imports_no_effect_and_no_random_number():
    done = subprocess.run(
        [sys.executable, "-P", "-c", IDEAL],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    loaded = done.stdout.split()
    assert "palpate.core.touch.pipeline" in loaded
    assert not [name for name in loaded if name.startswith("palpate.core.touch.effects")]
    assert not [name for name in loaded if name.startswith(("numpy.random", "scipy"))]


def test_without_effects_the_array_reads_the_compression(make_finger, make_touch):
    pipeline = assemble(make_finger(), [])
    (touch,) = measured(pipeline, [make_touch()])
    assert touch.outcome == "hit"
    assert np.array_equal(touch.reading, touch.compression)
    assert len(pipeline.stages) == 2


@pytest.mark.parametrize("given", [{}, {"reach": 1e-3}, {"depth": 2.9e-3}])
def test_an_array_of_forces_reads_the_compression_too_if_its_springs_are_ideal(
    given, make_finger, make_touch
):
    (touch,) = measured(assemble(make_finger(signal="force"), []), [make_touch(**given)])
    assert np.allclose(touch.reading, touch.compression, rtol=1e-15, atol=0.0)


def test_stages_act_by_place_and_within_a_place_as_given(make_finger, make_touch):
    notes = []
    marks = [Mark(phase, f"{phase.name} {i}", notes) for i in (1, 2) for phase in reversed(Phase)]
    marks = [mark for mark in marks if mark.phase is not Phase.CAST]
    pipeline = assemble(make_finger(), marks)
    measured(pipeline, [make_touch()])
    assert notes == [f"{p.name} {i}" for p in Phase if p is not Phase.CAST for i in (1, 2)]


def test_an_effect_of_the_cast_takes_its_place(make_finger, make_touch):
    notes = []
    pipeline = assemble(make_finger(), [Mark(Phase.CAST, "cast", notes)])
    with pytest.raises(ValueError, match="no finite"):  # nobody has cast anything
        measured(pipeline, [make_touch()])
    assert notes == ["cast"]


def test_two_effects_of_the_cast_are_refused(make_finger):
    marks = [Mark(Phase.CAST, name, []) for name in "ab"]
    with pytest.raises(ValueError, match="Mark and Mark both say how a taxel sees the surface"):
        assemble(make_finger(), marks)


def test_each_stage_is_given_its_own_state(make_finger, make_touch):
    marks = [Mark(Phase.SIGNAL, "a", []), Mark(Phase.AIM, "b", [])]
    pipeline = assemble(make_finger(), marks)
    assert pipeline.begin() == (0, None, None, 0)
    after = pipeline.simulate(make_touch(), (5, None, None, 8))
    assert after == (6, None, None, 9)


def test_noises_of_the_stages_add_as_squares(make_finger):
    assert assemble(make_finger(), []).noise == 0.0
    assert assemble(make_finger(), [Loud(3e-6), Loud(4e-6)]).noise == pytest.approx(5e-6)


def test_the_order_of_a_list_does_not_matter(make_finger, make_touch, values_of):
    names = ("quantisation", "gaussian_noise", "arm_backlash", "pose_error")
    found = []
    for order in itertools.permutations(names):
        touches = [make_touch(number) for number in range(3)]
        measured(assemble(make_finger(), effects_of(*order)), touches)
        found.append([values_of(touch) for touch in touches])
    assert all(values == found[0] for values in found)


@dataclass(frozen=True, slots=True)
class Probe:
    """Keeps the readings that pass it."""

    kept: list[Floats]
    phase: ClassVar = Phase.SIGNAL

    def prepare(self, finger):
        return Stage(lambda touch, state: self.kept.append(touch.reading))


def noise_beside(other, finger, touches):
    """What the Gaussian noise adds to each reading, in a pipeline that has another effect too."""
    before, after = Probe([]), Probe([])
    noise, others = effects_of("gaussian_noise"), effects_of(other)
    probed = [before, *noise, after]
    first = rank(other) < rank("gaussian_noise")
    measured(assemble(finger, [*others, *probed] if first else [*probed, *others]), touches)
    return np.subtract(after.kept, before.kept)


@pytest.mark.parametrize("other", [name for name in EFFECT_NAMES if name != "gaussian_noise"])
def test_an_effect_that_is_added_does_not_change_the_draws_of_another(
    other, make_finger, make_touch
):
    finger = make_finger()
    # A hit, a miss and a press to the bottom: what came of a touch changes no draw either.
    outcomes = [{}, {"reach": 1e-3}, {"depth": 2.9e-3}]
    touches = [make_touch(number, **given) for number, given in enumerate(outcomes)]
    draws = KeyedRandom(finger, "gaussian_noise")
    expected = [draws.of_touch(number).standard_normal((16, 16)) for number in range(3)]
    found = noise_beside(other, finger, touches) / 10e-6
    # Readings are of millimetres, and the sums of them and the noise are rounded as such.
    assert np.allclose(found, expected, rtol=0.0, atol=1e-10)


@dataclass(frozen=True)
class Odd:
    """An effect that does one thing wrong."""

    wrong: str = ""
    phase: ClassVar = Phase.LINK

    def prepare(self, finger):
        if self.wrong == "prepare":
            raise KeyError("gone")
        if self.wrong == "nothing":
            return None
        return Stage(self.apply, noise=float("nan") if self.wrong == "noise" else 0.0)

    def apply(self, touch, state):
        if self.wrong == "apply":
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
def test_an_effect_that_cannot_be_prepared_is_named(wrong, words, make_finger):
    with pytest.raises(ValueError, match=words):
        assemble(make_finger(), [Odd(wrong)])


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("apply", "the effect Odd failed: ZeroDivisionError: boom"),
        ("nan", "left a reading that is no finite"),
        ("shape", "left a reading that is no finite"),
        ("time", "left a touch that ends at -5.0 s"),
        ("copies", "is sent 0 times"),
    ],
)
def test_what_an_effect_leaves_is_checked(wrong, words, make_finger, make_touch):
    pipeline = assemble(make_finger(), [Odd(wrong)])
    with pytest.raises(ValueError, match=words):
        pipeline.simulate(make_touch(), pipeline.begin())


def test_every_stage_has_a_name(make_finger):
    assert assemble(make_finger(), [Odd()]).names == ("cast", "transducer", "Odd")


def test_a_touch_holds_what_the_press_was(make_finger, make_touch):
    finger, touch = make_finger(), make_touch()
    end = guarded_move(touch.shape, finger.pad, touch.actual, touch.reach, touch.depth)
    cast_single_rays(finger, touch)
    assert (touch.outcome, touch.advance) == ("hit", end.advance)
    assert np.array_equal(touch.compression, end.compression)
    assert np.array_equal(touch.indentation, end.indentation)
    assert np.array_equal(touch.actual, end.pose)


def test_pressure_is_the_force_of_each_taxel_over_its_area(make_finger, make_touch):
    finger, touch = make_finger(pitch=0.9e-3), make_touch()
    cast_single_rays(finger, touch)
    force = touch.pressure * finger.pad.pitch**2
    assert np.allclose(force, finger.calibration.taxel_stiffness * touch.compression, rtol=1e-14)


def test_the_arm_believes_to_have_gone_as_far_as_it_went(make_finger, make_touch):
    finger = make_finger()
    elsewhere = pose_of(np.array([0.01, 0.02, 0.04]), FACING_DOWN)
    touch = make_touch(believed=elsewhere)
    cast_single_rays(finger, touch)
    assert np.allclose(touch.believed[:3], elsewhere[:3] - [0.0, 0.0, touch.advance], atol=1e-16)
    assert np.array_equal(touch.believed[3:], elsewhere[3:])


def test_a_pose_advances_along_its_own_axis(rotations):
    for axes in rotations(5):
        pose = pose_of(np.array([0.1, -0.2, 0.3]), axes)
        way = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 1.0])
        assert np.allclose(advanced_pose(pose, 0.02)[:3], compose_poses(pose, way)[:3], atol=1e-16)


def test_times_of_a_hit_add_up_to_that_of_the_move(make_finger, make_touch):
    finger, touch = make_finger(), make_touch(begun=5.0, previous=4.0)
    cast_single_rays(finger, touch)
    robot = finger.robot
    assert touch.loading == pytest.approx(touch.depth / robot.approach)
    assert touch.dwell == robot.dwell
    assert touch.time == 5.0 + contact_seconds(robot, touch.advance)
    way_back = touch.advance / robot.retract + robot.overhead
    whole = touch.rest + touch.loading + touch.dwell + way_back
    assert whole == pytest.approx(touch.time - touch.previous, rel=1e-14)


@pytest.mark.parametrize(
    ("given", "outcome"),
    [({"reach": 1e-3}, "miss"), ({"actual": pose_of(np.zeros(3), FACING_DOWN)}, "inside")],
)
def test_a_pad_that_met_nothing_rested_all_while(given, outcome, make_finger, make_touch):
    finger, touch = make_finger(), make_touch(begun=5.0, previous=4.0, **given)
    cast_single_rays(finger, touch)
    assert touch.outcome == outcome
    assert (touch.loading, touch.dwell) == (0.0, 0.0)
    travel = touch.advance / finger.robot.approach
    assert touch.rest == pytest.approx(1.0 + travel + finger.robot.overhead)


def test_a_bottomed_pad_was_pressed_only_to_its_saturation(make_finger, make_touch):
    finger, touch = make_finger(), make_touch(depth=2.9e-3)
    cast_single_rays(finger, touch)
    assert touch.outcome == "bottomed"
    assert touch.loading == pytest.approx(0.8 * 3e-3 / finger.robot.approach)


def drawn(finger, name, number):
    return KeyedRandom(finger, name).of_touch(number).standard_normal(4096)


def test_a_touch_can_be_drawn_again_after_any_other(make_finger):
    draws = KeyedRandom(make_finger(), "drift")
    first = draws.of_touch(5).standard_normal(100)
    draws.once().random(7)
    draws.of_touch(6).integers(0, 9, size=3, dtype=np.uint32)  # leaves half a word over
    assert np.array_equal(draws.of_touch(5).standard_normal(100), first)
    assert np.array_equal(drawn(make_finger(), "drift", 5)[:100], first)


def test_what_is_drawn_once_is_apart_from_every_touch(make_finger):
    draws = KeyedRandom(make_finger(), "drift")
    once = draws.once().random(10_000)
    again = draws.once().random(10_000)
    first = draws.of_touch(0).random(10_000)
    assert np.array_equal(once, again)
    assert not np.intersect1d(once, first).size


def test_seed_finger_effect_and_touch_each_give_other_numbers(make_finger):
    samples = [
        drawn(make_finger(), "drift", 3),
        drawn(make_finger(seed=8), "drift", 3),
        drawn(make_finger(number=2), "drift", 3),
        drawn(make_finger(), "gaussian_noise", 3),
        drawn(make_finger(), "drift", 4),
    ]
    # The correlation of independent samples has a standard error of 1 / sqrt(n).
    correlations = np.corrcoef(samples) - np.eye(len(samples))
    assert np.abs(correlations).max() < 5 / np.sqrt(4096)


def test_numbers_of_successive_touches_are_independent(make_finger):
    draws = KeyedRandom(make_finger(), "drift")
    series = np.array([draws.of_touch(number).standard_normal() for number in range(4096)])
    for lag in (1, 2, 3):
        assert abs(np.mean(series[lag:] * series[:-lag])) < 5 / np.sqrt(4096)
    assert abs(series.mean()) < 5 / np.sqrt(4096)
    assert abs(series.var() - 1.0) < 5 * np.sqrt(2 / 4096)
