"""A winding whose resistance or back EMF changes with the shaft's angle, or that warms: told by what flows then."""

import math

import numpy as np
import pytest

from estimator import estimate_parameters, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 3.0, "K": 0.021, "L": 7.5e-3, "J": 1.16e-5, "B": 1.2e-5}
STEP, PARTS = 1e-3, 8  # s; of a row that is integrated at once
COPPER = 0.00393  # of R, a kelvin


def bench(volts, seed, *, segments=0.0, coils=0.0, heat=0.0):
    """Return the recording of voltages, (rows,), held over each row, by Runge and Kutta's method.

    Parameters
    ----------
    segments : float
        Share of R by which it changes ten times a turn.
    coils : float
        Share of K by which it changes ten times a turn.
    heat : float
        K/J of the winding, which loses none.
    """
    r, constant, inductance, j, b = MOTOR.values()

    def slopes(v, i, w, angle, warm):
        now = r * (1 + segments * math.cos(10 * angle)) * (1 + COPPER * warm)
        k = constant * (1 + coils * math.cos(10 * angle))
        return (v - now * i - k * w) / inductance, (k * i - b * w) / j, w, heat * now * i * i

    def moved(x, d, h):
        return [a + h * s for a, s in zip(x, d, strict=True)]

    rng, h = np.random.default_rng(seed), STEP / PARTS
    x, shown = [0.0, 0.0, float(rng.uniform(0, 6)), 0.0], np.zeros((len(volts), 2))
    for row, v in enumerate(volts.tolist()):
        shown[row] = x[:2]
        for _ in range(PARTS):
            one = slopes(v, *x)
            two = slopes(v, *moved(x, one, h / 2))
            three = slopes(v, *moved(x, two, h / 2))
            four = slopes(v, *moved(x, three, h))
            x = moved(x, [a + 2 * b + 2 * c + d for a, b, c, d in zip(one, two, three, four, strict=True)], h / 6)
    shown += rng.standard_normal(shown.shape) * [0.004, 0.3]
    columns = {"voltage [V]": volts, "current [A]": shown[:, 0], "speed [rad/s]": shown[:, 1]}
    return recording_from_arrays("bench", np.arange(len(volts)) * STEP, columns)


def off(result, names="RKLJB"):
    return {n: abs(p.value - MOTOR[n]) / p.standard_error for n, p in result.parameters.items() if n in names}


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.full), pytest.param(3, marks=pytest.mark.full)])
def test_segments_that_change_the_resistance_are_told_at_edges(seed):
    """The winding smooths what they do: in proportion to the current alone transients stayed unexplained, in doubt."""
    volts = np.repeat([0.0, 3.0, 6.0, 9.0, 12.0, 6.0, 3.0], [60, 500, 500, 500, 500, 500, 500])
    result = estimate_parameters(bench(volts, seed, segments=0.02), workers=1)
    assert result.verdict == "ok" and any("order 10" in note for note in result.notes), result.reasons
    assert max(off(result).values()) < 4.5, off(result)
    assert result.parameters["R"].standard_error < 2e-3 * MOTOR["R"]


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.full), pytest.param(3, marks=pytest.mark.full)])
def test_coils_that_change_the_back_emf_are_told_both_ways(seed):
    """The current is late behind it, and before it as the shaft turns back: one wave of the angle is not both."""
    volts = np.concatenate([np.zeros(60), np.tile(np.repeat([4.0, -4.0], 400), 3)])
    result = estimate_parameters(bench(volts, seed, coils=0.02), workers=1)
    assert result.verdict == "ok" and any("order 10" in note for note in result.notes), result.reasons
    assert max(off(result).values()) < 4.5, off(result)
    assert result.parameters["R"].standard_error < 2e-2 * MOTOR["R"]  # segments may change it, too


def test_a_winding_that_warms_is_told_by_the_current_that_flows_as_it_does():
    """By 7 %: by the current of a winding that stays cold a drift of friction and of the supply were told, in doubt."""
    volts = np.concatenate([np.zeros(100), np.tile(np.repeat([12.0, -12.0, 9.0, -9.0], 200), 5)])
    result = estimate_parameters(bench(volts, 1, heat=0.2), workers=1)
    assert result.verdict == "ok" and result.effects == ("winding warms",), (result.effects, result.reasons)
    assert max(off(result, "KLJB").values()) < 4.5, off(result)
    assert result.parameters["K"].standard_error < 1e-3 * MOTOR["K"]
