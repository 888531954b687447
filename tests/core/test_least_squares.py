"""Laws of the batched least-squares solver."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.core.arrays import Floats, Ints
from palpate.core.least_squares import Solutions, cauchy_loss, levenberg_marquardt, linear_loss

FREE = np.full(2, np.inf)


def rosenbrock(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
    x, y = parameters.T
    jacobian = np.zeros((len(x), 2, 2))
    jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 0] = -20 * x, 10.0, -1.0
    return np.stack([10 * (y - x * x), 1 - x], axis=1), jacobian


def solved(*start: float, low: Floats = -FREE, high: Floats = FREE, **options) -> Solutions:
    return levenberg_marquardt(rosenbrock, np.array([start]), low, high, **options)


def test_each_of_many_problems_finds_its_minimum():
    starts = np.random.default_rng(0).uniform(-2, 2, (200, 2))
    result = levenberg_marquardt(rosenbrock, starts, -FREE, FREE, steps=200)
    assert result.converged.all() and result.cost.max() < 1e-16
    assert np.abs(result.parameters - 1).max() < 1e-8
    for start, end, steps in zip(starts[:20], result.parameters, result.steps, strict=False):
        alone = solved(*start, steps=200)
        assert alone.steps[0] == steps
        assert np.allclose(alone.parameters[0], end, rtol=0, atol=1e-12)
    still = solved(1.0, 1.0)
    assert still.converged[0] and still.steps[0] == 0
    assert still.parameters[0].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("start", "high", "end"),
    [
        ((-1.0, 2.0), (0.5, np.inf), (0.5, 0.25)),
        ((2.0, 2.0), (2.0, 2.0), (1.0, 1.0)),  # a parameter leaves its bound when that helps
        ((5.0, 5.0), (0.8, 0.5), (np.sqrt(0.5), 0.5)),
    ],
)
def test_solution_is_optimal_within_bounds(start, high, end):
    result = solved(*start, high=np.array(high), steps=200)
    known = least_squares(
        lambda x: [10 * (x[1] - x[0] ** 2), 1 - x[0]], np.minimum(start, np.array(high) - 1e-9),
        bounds=(-np.inf, high), xtol=1e-15, ftol=1e-15, gtol=1e-15,
    )  # fmt: skip
    assert (result.parameters[0] <= high).all() and result.converged[0]
    assert result.cost[0] == pytest.approx(known.cost, rel=1e-6, abs=1e-15)
    if end[0] != np.sqrt(0.5):
        assert result.parameters[0] == pytest.approx(end, abs=1e-8)
    assert solved(5.0, 5.0, high=np.ones(2), steps=0).parameters[0].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("ours", "theirs"), [(linear_loss, "linear"), (cauchy_loss(0.1), "cauchy")]
)
def test_losses_lead_to_scipys_minima(ours, theirs):
    places = np.linspace(-1, 1, 40)
    values = 0.3 - 0.8 * places + 0.05 * np.random.default_rng(3).normal(size=40)
    values[::9] += 2.0
    rows = np.stack([np.ones(40), places], axis=1)

    def line(parameters: Floats, numbers: Ints) -> tuple[Floats, Floats]:
        return parameters @ rows.T - values, np.broadcast_to(rows, (len(numbers), 40, 2))

    result = levenberg_marquardt(line, np.zeros((1, 2)), -FREE, FREE, loss=ours, steps=200)
    known = least_squares(lambda x: rows @ x - values, [0, 0], loss=theirs, f_scale=0.1, xtol=1e-14)
    assert result.converged[0]
    assert result.parameters[0] == pytest.approx(known.x, abs=1e-6)
    assert result.cost[0] == pytest.approx(known.cost, rel=1e-9)
    squared, step = np.linspace(0.01, 3, 30), 1e-6
    slope = (ours(squared + step)[0] - ours(squared - step)[0]) / (2 * step)
    assert ours(squared)[1] == pytest.approx(slope, abs=1e-7)


def test_parameter_without_effect_stays():
    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        jacobian = np.zeros((len(rows), 3, 2))
        jacobian[:, :, 0] = 1.0
        return parameters[:, :1] - np.array([1.0, 2.0, 3.0]), jacobian

    result = levenberg_marquardt(problem, np.array([[9.0, 7.0]]), -FREE, FREE)
    assert result.converged[0]
    assert result.parameters[0] == pytest.approx([2.0, 7.0], abs=1e-9)


def test_iteration_ends_at_residual_or_step_limit():
    few = solved(-1.2, 1.0, steps=3)
    assert not few.converged[0] and few.steps[0] == 3
    rough, fine = solved(-1.2, 1.0, min_residual=0.1), solved(-1.2, 1.0)
    assert rough.converged[0] and rough.steps[0] < fine.steps[0]
    assert 1e-12 < np.sqrt(2 * rough.cost[0]) <= 0.1


def test_damping_falls_to_a_third_where_the_model_is_right():
    seen = []

    def problem(parameters: Floats, rows: Ints) -> tuple[Floats, Floats]:
        seen.append(parameters.item())
        return parameters, np.ones((1, 1, 1))

    levenberg_marquardt(problem, np.ones((1, 1)), -FREE[:1], FREE[:1], steps=3)
    left = np.array(seen[1:4]) / seen[:3]  # d / (1 + d) of the damping d
    damping = left / (1.0 - left)
    assert damping[1:] / damping[:-1] == pytest.approx([1 / 3, 1 / 3], rel=1e-9)
