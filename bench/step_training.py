"""Trains the network of the planner `learned`: python -m palpate.bench.step_training.

Of drawn objects slices are taken by chance, each with the one before it. The longest step after
which the side between two slices errs by less than was asked for is found by bisection of a table
of steps; the network learns a quantile of it, so that steps are rather too short than too long.
Prints the numbers for core/explore/planners/learned.py; the seed is fixed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize

from palpate.bench.radii import drawn_objects
from palpate.core.arrays import Floats
from palpate.core.explore import planners as rules

SEED, OBJECTS, PLACES = 1000, 150, 12  # Drawn with another seed than the objects of any bench
TOLERANCES = (5e-4, 1e-3, 2.5e-3, 5e-3)  # Over the height
MIN_STEP, MAX_STEP = rules.TRAINED.min_step, rules.TRAINED.max_step
STEPS = np.geomspace(MIN_STEP, MAX_STEP, 25)
BETWEEN = np.linspace(0.0, 1.0, 12)  # Places between two slices at which the side is compared
HIDDEN = 6
# Of the longest steps, which the network learns: of 0.05 to 0.25 the best on 60 other objects.
QUANTILE = 0.05
DECAY = 1e-3  # Of the weights' squares


def samples() -> Iterator[tuple[float, float, float, float]]:
    """Curvature, its change, error asked for and longest step, over the height."""
    rng = np.random.default_rng(SEED)
    for radius in drawn_objects(OBJECTS, SEED).values():
        trial = rules.PlannerTrial(radius)
        for _ in range(PLACES):
            here, way = rng.uniform(0.06, 0.94), rng.choice([-1.0, 1.0])
            before = here - way * rng.uniform(0.03, 0.3)
            if not 0.02 < before < 0.98:
                continue
            bend, last = (_bend(trial, share) for share in (here, before))
            errors = [
                _error(radius, trial, here, here + way * step)
                for step in STEPS.tolist()
                if 0.02 < here + way * step < 0.98
            ]
            for tolerance in TOLERANCES:
                bad = [i for i, error in enumerate(errors) if error > tolerance]
                if not bad and len(errors) < len(STEPS):
                    continue  # the object ends before anything errs
                longest = STEPS[max(bad[0] - 1, 0)] if bad else STEPS[-1]
                yield bend, abs(bend - last), tolerance, float(longest)


def _bend(trial: rules.PlannerTrial, share: float) -> float:
    return rules.mean_profile_curvature(
        trial.slice_at(share * rules.TRIAL.extent), rules.TRIAL.extent
    )


def _error(radius: rules.Radius, trial: rules.PlannerTrial, one: float, other: float) -> float:
    """Root mean square error of the side between two slices, over the height."""
    low, high = sorted((one, other))
    slices = [trial.slice_at(share * rules.TRIAL.extent) for share in (low, high)]
    places = low + (high - low) * BETWEEN
    squares = rules.hermite(rules.stack_slices(slices, 0.0, rules.TRIAL.extent), places)
    truth = rules.measure_side(radius, places, rules.TRIAL.azimuths)
    off = (np.sqrt(np.maximum(squares, 0.0)) - truth.radii) / np.sqrt(1.0 + truth.slopes**2)
    return float(np.sqrt(np.mean(off**2)))


def trained(given: Floats, wanted: Floats) -> rules.StepNetwork:
    """The network for inputs (n, 3), and steps (n,) as shares of the logarithm's way."""
    rng, count = np.random.default_rng(SEED), len(wanted)

    def parts(flat: Floats) -> rules.StepNetwork:
        inward, offset, outward = np.split(flat[:-1], [3 * HIDDEN, 4 * HIDDEN])
        return rules.StepNetwork(inward.reshape(3, HIDDEN), offset, outward, float(flat[-1]))

    def loss(flat: Floats) -> tuple[float, Floats]:
        net = parts(flat)
        hidden = np.tanh(given @ net.inward + net.offset)
        share = 1.0 / (1.0 + np.exp(-(hidden @ net.outward + net.bias)))
        off = wanted - share
        # A smooth form of the quantile's loss.
        width = 0.02
        soft = width * np.logaddexp(0.0, off / width)
        value = np.mean(soft - (1.0 - QUANTILE) * off) + DECAY * np.mean(flat**2)
        slope = (1.0 - QUANTILE) - 1.0 / (1.0 + np.exp(-np.clip(off / width, -500, 500)))
        back = slope * share * (1.0 - share) / count
        inner = back[:, None] * net.outward * (1.0 - hidden**2)
        found = [(given.T @ inner).ravel(), inner.sum(axis=0), hidden.T @ back, [back.sum()]]
        return float(value), np.concatenate(found) + 2.0 * DECAY * flat / len(flat)

    starts = rng.normal(size=(4, 5 * HIDDEN + 1))
    fits = [minimize(loss, start, jac=True, method="L-BFGS-B") for start in starts]
    return parts(np.asarray(min(fits, key=lambda one: float(one.fun)).x))


def main() -> None:
    """Train it, and print it."""
    table = np.array([*samples()])
    given = rules.network_inputs(*table[:, :3].T)
    wanted = np.log(table[:, 3] / MIN_STEP) / np.log(MAX_STEP / MIN_STEP)
    net = trained(given, wanted)
    steps = net.steps(*table[:, :3].T)
    print(f"# {len(table)} steps; {np.mean(steps > table[:, 3]):.0%} are too long")
    for name in ("inward", "offset", "outward", "bias"):
        print(f"{name} = {np.round(getattr(net, name), 3).tolist()}")


if __name__ == "__main__":
    main()
