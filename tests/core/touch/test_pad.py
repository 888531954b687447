"""The pad: its geometry, contact and signals, and guarded moves onto solids of every kind."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from palpate.core.arrays import Bools, Floats
from palpate.core.shapes import Superquadric, TriangleShape
from palpate.core.touch import HITS, Calibration, FaceModel, Pad, contact_mask, guarded_move
from tests.core.touch.touches import BALL, DOMED, FLAT, X, Y, above, finger, stage, touch

CONTACT, NOISE = 50e-6, 10e-6
SURFACES: dict[str, Callable[[Floats, Floats], Floats]] = {
    "ball": lambda x, y: 1e-3 - (x * x + y * y) / 0.04,
    "cylinder": lambda x, y: 1e-3 - (0.6 * x + 0.8 * y) ** 2 / 0.04,
    "ridge": lambda x, y: 1e-3 - np.abs(x + 0.2e-3),
    "corner": lambda x, y: 1.5e-3 - np.maximum(np.abs(x), np.abs(y + 0.3e-3)),
    "two balls": lambda x, y: 0.8e-3 - ((np.abs(x) - 4e-3) ** 2 + y * y) / 0.01,
}


def test_grid_is_centred_and_the_dome_is_a_paraboloid():
    small = Pad(rows=3, cols=4, pitch=0.002, thickness=0.003, dome=50.0, saturation=0.8)
    x, y = small.grid()
    assert np.allclose(x, np.tile([-0.003, -0.001, 0.001, 0.003], (3, 1)))
    assert np.allclose(y, np.tile([[-0.002], [0.0], [0.002]], (1, 4)))
    assert np.allclose(small.sag(), 25.0 * (x**2 + y**2)) and (FLAT.sag() == 0.0).all()
    assert np.allclose(DOMED.transducers()[:, 2], -3e-3 - DOMED.sag().ravel())
    surface = small.surface(np.full((3, 4), 1e-3), x > 0.0)
    assert np.allclose(surface, np.where(x > 0.0, -1e-3 - small.sag(), 0.0))
    assert np.allclose(small.surface_point(surface, 6), [0.001, 0.0, surface[1, 2]])


def pressed(name: str, surface: str, **parameters: float) -> tuple[Pad, Floats, Bools]:
    """The pad as its data sheet has it, what it reads, and where it is really touched."""
    field = SURFACES[surface](X, Y)
    springs = np.maximum(field, 0.0)
    contact = touch(field=field, compression=springs, pressure=2e8 * springs)
    made = stage(name, **parameters)
    made.apply(contact, made.state)
    return replace(FLAT, face=made.face), contact.compression, contact.pressure > 0.0


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize(
    ("effect", "options"), [("half_space", {}), ("tenting", {}), ("tenting", {"decay": 2e-3})]
)
def test_skirt_beside_a_contact_is_not_contact(effect, options, surface):
    pad, reading, truly = pressed(effect, surface, **options)
    result = contact_mask(pad, reading, CONTACT, 0.0)
    assert ((reading > CONTACT) & ~truly).sum() > 5  # there is a skirt to be mistaken for contact
    assert not (result & ~truly).any()
    # A taxel at the rim that is met without pressure is given up: of the two rows on a ridge the
    # deeper one carries a stiff skin alone.
    least = 0.5 if surface == "ridge" else 0.6
    assert result.sum() >= least * (truly & (reading > CONTACT)).sum()
    assert result.flat[reading.argmax()]


def test_on_springs_compression_is_contact():
    reading = SURFACES["ball"](X, Y)
    for noise, least in ((0.0, CONTACT), (20e-6, 100e-6)):
        assert np.array_equal(contact_mask(FLAT, reading, CONTACT, noise), reading > least)


@pytest.mark.parametrize("face", [FaceModel("membrane", 1e-3), FaceModel("half_space")])
def test_noise_makes_no_contact_and_an_even_press_is_all_contact(face):
    rng, effect = np.random.default_rng(0), "tenting" if face.decay else "half_space"
    pad, reading, truly = pressed(effect, "ball")
    assert pad.face == face
    for noise in NOISE * rng.standard_normal((50, 16, 16)):
        assert not contact_mask(pad, noise, CONTACT, NOISE).any()
        result = contact_mask(pad, reading + noise, CONTACT, NOISE)
        assert not (result & ~truly).any() and result.sum() >= 0.6 * truly.sum()
    for share, touched in ((1.01, True), (0.99, False)):  # from the least compression on
        even = contact_mask(pad, np.full((16, 16), share * CONTACT), CONTACT, 0.0)
        assert (even == touched).all()


ECHO, FORCE = (finger(signal).calibration for signal in ("time", "force"))


def test_signals_follow_1_1_and_1_2():
    compression = np.random.default_rng(0).uniform(0.0, 2.4e-3, (16, 16))
    assert np.allclose(ECHO.encode(compression), 2.0 * (3e-3 - compression) / 1000.0, rtol=1e-15)
    assert np.allclose(FORCE.encode(compression), 200.0 * compression, rtol=1e-15)
    for sheet in (ECHO, FORCE):
        back = sheet.decode(sheet.encode(compression))
        assert np.allclose(back, compression, rtol=0, atol=2e-18)


def test_gain_offset_and_speed_enter_the_decoder_alone():
    gain, offset = np.array([[1.1, 0.9]]), np.array([[1e-5, -2e-5]])
    read = (1e-3 - offset) / gain
    corrected = Calibration("time", 3e-3, 1000.0, 200.0, gain=gain, offset=offset)
    assert np.allclose(corrected.encode(read), ECHO.encode(read), rtol=1e-15)
    assert np.allclose(corrected.decode(ECHO.encode(read)), 1e-3, rtol=1e-12)
    slow = Calibration("time", 3e-3, 985.0, 200.0)  # a wrong speed is an error of thickness
    seen = slow.decode(ECHO.encode(np.array([1e-3])))[0]
    assert seen == pytest.approx(3e-3 - 2e-3 * 985.0 / 1000.0, rel=1e-12)


def test_frames_of_another_array_or_unit_are_refused():
    own = replace(ECHO, gain=np.ones((16, 16)))
    with pytest.raises(ValueError, match=r"a frame must have shape \(16, 16\), got \(4, 4\)"):
        own.decode(np.zeros((4, 4)))
    with pytest.raises(ValueError, match="times are in seconds; multiply microseconds by 1e-6"):
        ECHO.decode(1e6 * ECHO.encode(np.zeros((16, 16))))
    assert np.isfinite(ECHO.decode(np.full((16, 16), 5e-3))).all()  # late, but of this unit


# Guarded moves

REACH, EXACT = 0.1, 1e-12
BALL_MOVES = [
    # height, aside, reach and depth [m], and the outcome
    (0.05, 0.0, REACH, 1e-3, "hit"),
    (0.0329, 0.0, REACH, 0.1e-3, "hit"),
    (0.05, 0.0, REACH, 2.9e-3, "bottomed"),
    (0.05, 0.04, REACH, 1e-3, "miss"),
    (0.05, 0.0, 0.0199, 1e-3, "miss"),
    (-0.05, 0.0, REACH, 1e-3, "miss"),
    (0.0298, 0.0, REACH, 1e-3, "inside"),  # the face alone; the transducers are outside
    (0.026, 0.0, REACH, 1e-3, "inside"),
    (0.0, 0.0, REACH, 1e-3, "inside"),
    (-0.0295, 0.0, REACH, 1e-3, "inside"),  # in the far half, near the exit
]


@pytest.mark.parametrize("pad", [FLAT, DOMED], ids=["flat", "domed"])
@pytest.mark.parametrize("facets", [EXACT, 2e-5], ids=["exact", "mesh"])
def test_move_onto_a_ball_ends_as_geometry_says(facets, pad):
    # The middle four taxels are half a pitch off the axis.
    first = np.sqrt(0.03**2 - X**2 - Y**2) - pad.sag()
    solid = BALL if facets == EXACT else TriangleShape(*BALL.mesh(5))
    for height, aside, reach, depth, outcome in BALL_MOVES:
        start = above(height, aside)
        end = guarded_move(solid, pad, start, reach, depth)
        assert end.outcome == outcome, (height, aside)
        wanted = np.zeros((16, 16))
        if outcome in HITS:
            wanted = np.maximum(min(depth, 2.4e-3) - (first.max() - first), 0.0)
            assert end.compression.max() == pytest.approx(min(depth, 2.4e-3), abs=EXACT)
            assert end.advance == pytest.approx(height - first.max() + wanted.max(), abs=facets)
        else:
            assert end.advance == (reach if outcome == "miss" else 0.0)
        assert np.allclose(end.compression, wanted, rtol=0, atol=facets)
        assert np.allclose(end.pose.position, [aside, 0, height - end.advance], atol=1e-15)
        assert np.array_equal(np.maximum(end.indentation, 0.0), end.compression)


@pytest.mark.parametrize("exponents", [(0.02, 0.02), (0.02, 2.0), (2.0, 0.02)])
def test_casts_from_afar_at_extreme_exponents_stay_exact(exponents):
    solid = Superquadric(np.array([0.03, 0.001, 0.04]), np.array(exponents))
    e1, e2 = np.array(exponents, np.longdouble)
    a, b, c = solid.size.astype(np.longdouble)
    across = (np.abs(X / a) ** (2 / e2) + np.abs(Y / b) ** (2 / e2)) ** (e2 / e1)
    heights = c * np.maximum(1 - across, 0) ** (e1 / 2)
    for far in (0.1, 9.0):
        end = guarded_move(solid, FLAT, above(far), 10.0, 1e-3)
        assert end.outcome == "hit"
        met = np.isfinite(end.indentation)
        off = far - end.advance + end.indentation[met] - heights[met]
        assert np.abs(off).max() < 1e-11  # 9 m has fewer digits left
        assert guarded_move(solid, FLAT, above(-far), 10.0, 1e-3).outcome == "miss"
