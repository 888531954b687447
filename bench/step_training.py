"""Trains the network of the planner `learned`: python -m palpate.bench.step_training.

Slices of drawn objects are chosen at random, each with the one before it. From a table of steps
the longest one is taken after which the error of the side between two slices is within the
tolerance. The network learns a low quantile of it, because steps that are too long cost more than
short ones. Prints the numbers for core/explore/planners/learned.py; the seed is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from palpate.bench.radii import drawn_objects
from palpate.core.arrays import Floats
from palpate.core.explore import planners as rules

MIN_STEP, MAX_STEP = rules.TRAINED.min_step, rules.TRAINED.max_step


@dataclass(frozen=True, slots=True, kw_only=True)
class TrainingSettings:
    """Samples, network and loss."""

    seed: int = 1000  # of objects, slices and starts; no bench has the same
    n_objects: int = 150
    n_slices: int = 12  # of an object
    tolerances: tuple[float, ...] = (5e-4, 1e-3, 2.5e-3, 5e-3)  # [fraction of the height]
    n_steps: int = 25  # tried step lengths, from the smallest to the largest
    n_compared: int = 12  # heights between two slices at which the side is compared
    margin: float = 0.02  # [fraction of the height] at the ends, without slices
    n_hidden: int = 6  # units of the network
    quantile: float = 0.05  # of the longest steps; the best of 0.05 to 0.25 on 60 other objects
    loss_width: float = 0.02  # [fraction of the log range of steps] of the loss's smoothed kink
    decay: float = 1e-3  # factor of the mean squared weight in the loss
    n_starts: int = 4  # of the minimisation, with random weights; the best is kept


def samples(settings: TrainingSettings) -> Iterator[tuple[float, float, float, float]]:
    """Curvature, its change, tolerance and longest step, as fractions of the height."""
    rng, margin = np.random.default_rng(settings.seed), settings.margin
    table = np.geomspace(MIN_STEP, MAX_STEP, settings.n_steps)
    for radius in drawn_objects(settings.n_objects, settings.seed).values():
        trial = rules.PlannerTrial(radius)
        for _ in range(settings.n_slices):
            height, side = rng.uniform(0.06, 0.94), rng.choice([-1.0, 1.0])
            last = height - side * rng.uniform(0.03, 0.3)
            if not margin < last < 1.0 - margin:
                continue
            curvature, last_curvature = (_curvature(trial, share) for share in (height, last))
            errors = [
                _error(radius, trial, height, height + side * step, settings.n_compared)
                for step in table.tolist()
                if margin < height + side * step < 1.0 - margin
            ]
            for tolerance in settings.tolerances:
                bad = [i for i, error in enumerate(errors) if error > tolerance]
                if not bad and len(errors) < len(table):
                    continue  # the object ends before any error exceeds the tolerance
                longest = table[max(bad[0] - 1, 0)] if bad else table[-1]
                yield curvature, abs(curvature - last_curvature), tolerance, float(longest)


def _curvature(trial: rules.PlannerTrial, share: float) -> float:
    extent = trial.settings.extent
    return rules.mean_profile_curvature(trial.slice_at(share * extent), extent)


def _error(
    radius: rules.Radius, trial: rules.PlannerTrial, first: float, second: float, n_compared: int
) -> float:
    """Root mean square error of the side between two slices, as a fraction of the height."""
    low, high = sorted((first, second))
    extent = trial.settings.extent
    slices = [trial.slice_at(share * extent) for share in (low, high)]
    heights = low + (high - low) * np.linspace(0.0, 1.0, n_compared)
    squares = rules.hermite(rules.stack_slices(slices, 0.0, extent), heights)
    truth = rules.measure_side(radius, heights, trial.settings.azimuths)
    errors = (np.sqrt(np.maximum(squares, 0.0)) - truth.radii) / np.sqrt(1.0 + truth.slopes**2)
    return float(np.sqrt(np.mean(errors**2)))


def trained(inputs: Floats, targets: Floats, settings: TrainingSettings) -> rules.StepNetwork:
    """The network for inputs (n, 3) and target steps (n,), from 0 to 1 on a logarithmic scale."""
    rng, n_hidden = np.random.default_rng(settings.seed), settings.n_hidden

    def network_of(flat: Floats) -> rules.StepNetwork:
        inward, offset, outward = np.split(flat[:-1], [3 * n_hidden, 4 * n_hidden])
        return rules.StepNetwork(inward.reshape(3, n_hidden), offset, outward, float(flat[-1]))

    def loss(flat: Floats) -> tuple[float, Floats]:
        return _quantile_loss(network_of(flat), flat, inputs, targets, settings)

    starts = rng.normal(size=(settings.n_starts, 5 * n_hidden + 1))
    fits = [minimize(loss, start, jac=True, method="L-BFGS-B") for start in starts]
    return network_of(np.asarray(min(fits, key=lambda fit: float(fit.fun)).x))


def _quantile_loss(
    net: rules.StepNetwork,
    flat: Floats,
    inputs: Floats,
    targets: Floats,
    settings: TrainingSettings,
) -> tuple[float, Floats]:
    """A smooth form of the loss of a quantile, with decay of the weights, and its gradient."""
    width, decay, quantile = settings.loss_width, settings.decay, settings.quantile
    hidden = np.tanh(inputs @ net.inward + net.offset)
    share = 1.0 / (1.0 + np.exp(-(hidden @ net.outward + net.bias)))
    residuals = targets - share
    soft = width * np.logaddexp(0.0, residuals / width)
    value = np.mean(soft - (1.0 - quantile) * residuals) + decay * np.mean(flat**2)
    slope = (1.0 - quantile) - 1.0 / (1.0 + np.exp(-np.clip(residuals / width, -500, 500)))
    back = slope * share * (1.0 - share) / len(targets)
    inner = back[:, None] * net.outward * (1.0 - hidden**2)
    parts = [(inputs.T @ inner).ravel(), inner.sum(axis=0), hidden.T @ back, [back.sum()]]
    return float(value), np.concatenate(parts) + 2.0 * decay * flat / len(flat)


def main() -> None:
    """Train the network and print its weights."""
    settings = TrainingSettings()
    table = np.array([*samples(settings)])
    inputs = rules.network_inputs(*table[:, :3].T)
    targets = np.log(table[:, 3] / MIN_STEP) / np.log(MAX_STEP / MIN_STEP)
    net = trained(inputs, targets, settings)
    steps = net.steps(*table[:, :3].T)
    print(f"# {len(table)} steps; {np.mean(steps > table[:, 3]):.0%} are too long")
    for name in ("inward", "offset", "outward", "bias"):
        print(f"{name} = {np.round(getattr(net, name), 3).tolist()}")


if __name__ == "__main__":
    main()
