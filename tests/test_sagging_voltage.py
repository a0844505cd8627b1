"""A voltage that is measured at the motor, behind a source that sags: how it falls between two samples is not known."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, held_response

from estimator import estimate_parameters, recording_from_arrays

STEP, INSIDE = 1e-3, 0.6  # s, Ohm
COMMAND = np.repeat([0.0, 10.0, 5.0], [60, 500, 500])


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in range(1, 6))])
def test_an_inductance_behind_it_is_known_to_half_an_interval(seed):
    """Samples were taken for the means of their intervals: L was 5 standard errors too large, and ok."""
    whole = dataclasses.replace(CML050, R=CML050.R + INSIDE)
    shown = held_response(whole, COMMAND, step=STEP)
    rng = np.random.default_rng(seed)
    columns = {
        "voltage [V]": COMMAND - INSIDE * shown[:, 0] + 0.02 * rng.standard_normal(len(COMMAND)),
        "current [A]": shown[:, 0] + 0.01 * rng.standard_normal(len(COMMAND)),
        "speed [rad/s]": shown[:, 1] + 0.5 * rng.standard_normal(len(COMMAND)),
    }
    found = estimate_parameters(recording_from_arrays("sag", STEP * np.arange(len(COMMAND)), columns), workers=1)
    # By seed 5 a voltage that is held is a rival: its L is 2.4 % larger, which the bars hold.
    assert found.verdict == "ok" or (seed == 5 and "v held from row to row" in found.reasons[0]), found.reasons
    off = {n: (p.value - getattr(CML050, n)) / p.standard_error for n, p in found.parameters.items()}
    assert max(map(abs, off.values())) < 4.5, off
    assert 0.5 * INSIDE * STEP / 2 < found.parameters["L"].standard_error < INSIDE * STEP
