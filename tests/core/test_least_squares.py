import numpy as np
import pytest
from scipy.optimize import least_squares

from palpate.core.least_squares import FIRST_DAMPING, cauchy_loss, levenberg_marquardt, linear_loss

FREE = np.full(2, np.inf)


def rosenbrock(parameters, rows):
    x, y = parameters.T
    jacobian = np.zeros((len(x), 2, 2))
    jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 0] = -20 * x, 10.0, -1.0
    return np.stack([10 * (y - x * x), 1 - x], axis=1), jacobian


def line_through(places, values):
    def problem(parameters, rows):
        model = parameters[:, :1] + parameters[:, 1:] * places
        one = np.broadcast_to(np.stack([np.ones_like(places), places], -1), (*model.shape, 2))
        return model - values, one

    return problem


def test_each_problem_of_many_finds_its_minimum():
    starts = np.random.default_rng(0).uniform(-2, 2, (200, 2))
    found = levenberg_marquardt(rosenbrock, starts, -FREE, FREE, steps=200)
    assert found.converged.all()
    assert np.abs(found.parameters - 1).max() < 1e-8
    assert found.cost.max() < 1e-16


def test_a_problem_ends_the_same_alone_and_among_others():
    starts = np.random.default_rng(1).uniform(-2, 2, (20, 2))
    together = levenberg_marquardt(rosenbrock, starts, -FREE, FREE)
    alone = [levenberg_marquardt(rosenbrock, start[None], -FREE, FREE) for start in starts]
    assert np.array_equal(together.steps, [one.steps[0] for one in alone])
    parameters = np.concatenate([one.parameters for one in alone])
    assert np.allclose(together.parameters, parameters, rtol=0, atol=1e-12)


def test_a_start_at_the_solution_takes_no_step():
    found = levenberg_marquardt(rosenbrock, np.ones((1, 2)), -FREE, FREE)
    assert found.converged[0] and found.steps[0] == 0
    assert found.parameters[0].tolist() == [1.0, 1.0]


def test_bounds_hold_and_the_rest_is_best_within_them():
    high = np.array([0.5, np.inf])
    found = levenberg_marquardt(rosenbrock, np.array([[-1.0, 2.0]]), -FREE, high, steps=200)
    assert found.converged[0]
    assert found.parameters[0] == pytest.approx([0.5, 0.25], abs=1e-9)


def test_a_parameter_leaves_its_bound_when_that_helps():
    found = levenberg_marquardt(
        rosenbrock, np.array([[2.0, 2.0]]), -FREE, np.full(2, 2.0), steps=200
    )
    assert found.parameters[0] == pytest.approx([1.0, 1.0], abs=1e-8)


def test_starts_are_moved_into_the_bounds():
    found = levenberg_marquardt(rosenbrock, np.array([[5.0, 5.0]]), -FREE, np.ones(2), steps=0)
    assert found.parameters[0].tolist() == [1.0, 1.0]


def test_the_path_does_not_depend_on_the_units_of_a_parameter():
    scale = np.array([1e-6, 1e5])

    def scaled(parameters, rows):
        residuals, jacobian = rosenbrock(parameters / scale, rows)
        return residuals, jacobian / scale

    start = np.array([[-1.2, 1.0]])
    plain = levenberg_marquardt(rosenbrock, start, -FREE, FREE)
    other = levenberg_marquardt(scaled, start * scale, -FREE, FREE)
    assert other.steps[0] == plain.steps[0]
    assert other.parameters / scale == pytest.approx(plain.parameters, abs=1e-9)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [(linear_loss, "linear"), (cauchy_loss(0.1), "cauchy")],
)
def test_losses_lead_to_the_minima_that_scipy_finds(ours, theirs):
    rng = np.random.default_rng(3)
    places = np.linspace(-1, 1, 40)
    values = 0.3 - 0.8 * places + 0.05 * rng.normal(size=40)
    values[::9] += 2.0
    problem = line_through(places, values)
    found = levenberg_marquardt(problem, np.zeros((1, 2)), -FREE, FREE, loss=ours, steps=200)
    known = least_squares(
        lambda x: x[0] + x[1] * places - values, [0, 0], loss=theirs, f_scale=0.1, xtol=1e-14
    )
    assert found.converged[0]
    assert found.parameters[0] == pytest.approx(known.x, abs=1e-6)
    assert found.cost[0] == pytest.approx(known.cost, rel=1e-9)


@pytest.mark.parametrize("loss", [linear_loss, cauchy_loss(0.3)])
def test_the_weight_is_the_derivative_of_the_loss(loss):
    squared, step = np.linspace(0.01, 3, 30), 1e-6
    slope = (loss(squared + step)[0] - loss(squared - step)[0]) / (2 * step)
    assert loss(squared)[1] == pytest.approx(slope, abs=1e-7)


def test_a_parameter_that_does_nothing_stays_where_it_is():
    def problem(parameters, rows):
        jacobian = np.zeros((len(rows), 3, 2))
        jacobian[:, :, 0] = 1.0
        return parameters[:, :1] - np.array([1.0, 2.0, 3.0]), jacobian

    found = levenberg_marquardt(problem, np.array([[9.0, 7.0]]), -FREE, FREE)
    assert found.converged[0]
    assert found.parameters[0] == pytest.approx([2.0, 7.0], abs=1e-9)


def test_too_few_steps_are_stated():
    found = levenberg_marquardt(rosenbrock, np.array([[-1.2, 1.0]]), -FREE, FREE, steps=3)
    assert not found.converged[0] and found.steps[0] == 3


def test_enough_is_where_a_problem_stops():
    start = np.array([[-1.2, 1.0]])
    rough = levenberg_marquardt(rosenbrock, start, -FREE, FREE, enough=0.1)
    fine = levenberg_marquardt(rosenbrock, start, -FREE, FREE)
    assert rough.converged[0] and rough.steps[0] < fine.steps[0]
    assert 1e-12 < np.sqrt(2 * rough.cost[0]) <= 0.1


def test_where_the_model_is_right_damping_falls_to_a_third_with_each_step():
    seen = []

    def problem(parameters, rows):
        seen.append(parameters.item())
        return parameters, np.ones((1, 1, 1))

    far = np.full(1, np.inf)
    levenberg_marquardt(problem, np.ones((1, 1)), -far, far, steps=3)
    damping = FIRST_DAMPING / 3.0 ** np.arange(3)
    assert np.array(seen[1:4]) / seen[:3] == pytest.approx(damping / (1.0 + damping), rel=1e-9)
