import numpy as np

from palpate.core.touch.effects.electronics import GaussianNoise


def test_the_noise_has_the_asked_variance_and_no_mean(make_finger, readings, dent):
    noise = readings(GaussianNoise(sigma=20e-6).prepare(make_finger()), dent, 200) - dent
    count = noise.size
    assert abs(noise.mean()) < 5 * 20e-6 / np.sqrt(count)
    # The variance of a normal sample has a relative standard error of sqrt(2 / n).
    assert abs(noise.var() / 20e-6**2 - 1.0) < 5 * np.sqrt(2 / count)


def test_the_noise_is_normal(make_finger, readings, dent):
    noise = (readings(GaussianNoise(sigma=1e-4).prepare(make_finger()), dent, 200) - dent) / 1e-4
    # Skewness and kurtosis of a normal sample have variances of 6 / n and 24 / n.
    assert abs(np.mean(noise**3)) < 5 * np.sqrt(15 / noise.size)
    assert abs(np.mean(noise**4) - 3.0) < 5 * np.sqrt(96 / noise.size)


def test_neither_taxels_nor_touches_are_correlated(make_finger, readings, dent):
    noise = (readings(GaussianNoise(sigma=1e-4).prepare(make_finger()), dent, 200) - dent) / 1e-4
    for here, there in [
        (noise[1:], noise[:-1]),
        (noise[:, 1:], noise[:, :-1]),
        (noise[:, :, 1:], noise[:, :, :-1]),
    ]:
        assert abs(np.mean(here * there)) < 5 / np.sqrt(here.size)


def test_a_calibration_finds_it_as_it_is(make_finger):
    assert GaussianNoise(sigma=7e-6).prepare(make_finger()).noise == 7e-6
