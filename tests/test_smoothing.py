"""Signals smoothed in a table after the recording, by means that are centred."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, off

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.effects.smoothing import centred_mean

pytestmark = pytest.mark.usefixtures("shared_workers")

LEVELS = np.repeat([0.0, 9.0, 3.0, 6.0], [100, 200, 200, 200])
UNITS = {"current": "A", "speed": "rad/s"}


def smoothed(y, n):
    """Return means of n samples around each, of fewer at the ends, as a table makes them."""
    reach = n // 2
    return np.array([np.mean(y[max(0, k - reach) : k + reach + 1]) for k in range(len(y))])


def test_it_is_the_mean_of_as_many_samples_around_each():
    y = np.random.default_rng(1).standard_normal(60)
    for n in (3.0, 5.0, 21.0):
        reach = round(n) // 2
        assert centred_mean(y, n, STEP)[reach:-reach] == pytest.approx(smoothed(y, round(n))[reach:-reach])
    assert centred_mean(np.ones(10), 7.0, STEP) == pytest.approx(np.ones(10))


@pytest.mark.parametrize(
    ("which", "n"), [(("current", "speed"), 7), (("current",), 5), pytest.param(("speed",), 9, marks=pytest.mark.full)]
)
def test_what_was_smoothed_is_told_with_its_samples_and_nothing_else(which, n):
    """A ramp of the voltage, a drop of the brushes and an inductance that falls were told, from before the input on."""
    raw = bench(LEVELS, np.repeat(LEVELS, FINE), 3).signals
    shown = {name: smoothed(raw[name], n) if name in which else raw[name] for name in UNITS}
    columns = {"voltage [V]": LEVELS} | {f"{name} [{UNITS[name]}]": y for name, y in shown.items()}
    result = estimate_parameters(recording_from_arrays("table", STEP * np.arange(len(LEVELS)), columns), workers=1)
    assert set(result.effects) == {"smoothing"} and result.verdict == "doubtful", (result.effects, result.reasons)
    (told,) = [reason for reason in result.reasons if "smoothed by a centred mean" in reason]
    names = "i and w" if len(which) == 2 else which[0].replace("current", "i").replace("speed", "w")
    assert told.startswith(f"{names}: smoothed by a centred mean over {n} samples")
    assert off(result).max() < 5, result.parameters
    assert set(result.parameters) == set(MOTOR)
