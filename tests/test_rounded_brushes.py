"""Brushes whose drop is rounded off, at one voltage before the circuit opens, by an encoder; steps by Runge-Kutta."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimator import estimate_parameters, recording_from_arrays
from estimator.explaining.effects.of_signals import _spread
from estimator.fitting.motor_response import ENDS, ONE_WAY, OPEN, openings
from estimator.noise.clock import Clock

TRUE = {"R": 3.2, "K": 0.0121, "L": 5.7e-3, "J": 3.5e-7, "B": 3.4e-6}
DROP, ROUND_AT = 1.0, 0.13  # V, A
STEP, ROWS, ON, OFF, FINE = 5e-4, 450, 100, 237, 8
COUNTS = 2000  # a turn


def turned():
    """Return current, A, and angle, rad, of each row: from rest to 9 V, then without a circuit."""
    r, k, inductance, j, b = TRUE.values()

    def rates(x, v, closed):
        i, w, _ = x
        drop = DROP * np.tanh(i / ROUND_AT)
        return np.array([closed * (v - r * i - k * w - drop) / inductance, (k * i - b * w) / j, w])

    x, rows, h = np.zeros(3), [], STEP / FINE
    for row in range(ROWS):
        rows.append(x.copy())
        v, closed = (9.0, 1.0) if ON <= row < OFF else (0.0, float(row < ON))
        if row >= OFF:
            x[0] = 0.0
        for _ in range(FINE):
            a = rates(x, v, closed)
            c = rates(x + 0.5 * h * a, v, closed)
            d = rates(x + 0.5 * h * c, v, closed)
            x = x + h / 6 * (a + 2 * c + 2 * d + rates(x + h * d, v, closed))
    return np.array(rows)[:, 0], np.array(rows)[:, 2]


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.full), pytest.param(2, marks=pytest.mark.full)])
def test_a_drop_that_is_rounded_off_is_in_the_bars_at_one_level(seed):
    """R was 9 and L 14 standard errors off: it was told as a sag, and a fifth of the drop.

    What a drop changes was shown half a row early, as the counts' mean, and not at all in the row of the edge.
    """
    rng = np.random.default_rng(seed)
    current, angle = turned()
    counts = np.floor(angle * COUNTS / (2 * np.pi) + rng.random())
    columns = {
        "voltage [V]": np.where((np.arange(ROWS) >= ON) & (np.arange(ROWS) < OFF), 9.0, 0.0),
        "current [A]": current + 5e-3 * rng.standard_normal(ROWS),
        "speed [rad/s]": np.diff(counts, prepend=counts[0]) * 2 * np.pi / COUNTS / STEP,
    }
    recording = recording_from_arrays("brushes", STEP * np.arange(ROWS), columns)
    found = estimate_parameters(recording, workers=1)
    off = {n: abs(p.value - TRUE[n]) / p.standard_error for n, p in found.parameters.items()}
    assert max(off.values()) < 4, (off, found.effects)
    assert "rounded brush drop" in found.effects and "sag" not in found.effects


def test_a_current_flows_in_the_row_that_it_begins_in_and_ends_within_its_last():
    """Where none flows back: it was taken to be zero in the first row, and to flow for the whole of the last."""
    shown = np.array([0.0, 0.0, 0.0, 0.6, 1.0, 0.4, 0.0, 0.0])[:, None]
    simulator = SimpleNamespace(
        plan=SimpleNamespace(observed=[None]), outputs=("i",), rows=8, index={ONE_WAY: 0},
        clocks=(Clock(STEP * np.arange(8), slice(0, 8)),),
    )  # fmt: skip
    fit = SimpleNamespace(simulator=simulator, value=lambda name: 1.0, shown=shown)
    assert openings(fit).tolist() == [OPEN, OPEN, 0, 0, 0, ENDS, OPEN, OPEN]


@pytest.mark.parametrize("along", [0.0, -1.0])
def test_of_a_drop_that_explains_nothing_no_form_is_told(along):
    """Its deviations were columns of no number, at which the whitener stopped: an internal error."""
    nothing = SimpleNamespace(scores=lambda columns: (np.full(columns.shape[2], along), np.ones(columns.shape[2])))
    assert _spread(nothing, np.ones((5, 2, 1)), np.ones((5, 2, 3))) is None
