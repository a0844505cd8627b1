"""A single sample that is far off behind an edge is an outlier there as anywhere, and no onset of a response."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, STEP, bench, off

from estimator import estimate_parameters, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMAND = np.repeat([0.0, 9.0, 4.0, 8.0, -5.0], [100, 250, 250, 250, 250])
UNITS = {"voltage": "V", "current": "A", "speed": "rad/s"}
EDGES = [102, 352, 603, 851]
AS_A_DELAY = (851, 3.0)  # between its neighbours


@pytest.mark.parametrize(
    ("row", "by"),
    [(row, by) if (row, by) == (102, -3.0) else pytest.param(row, by, marks=pytest.mark.full)
     for row in EDGES for by in (-3.0, 3.0) if (row, by) != AS_A_DELAY],
)  # fmt: skip
def test_a_spike_behind_an_edge_moves_nothing(row, by):
    """It was no outlier there, and made a latency of its edge: filters, limits and saturation were told, R by 28 %."""
    whole = bench(COMMAND, np.repeat(COMMAND, FINE), 3)
    columns = {f"{name} [{unit}]": whole.signals[name].copy() for name, unit in UNITS.items()}
    columns["current [A]"][row] += by
    result = estimate_parameters(recording_from_arrays("b", np.arange(len(COMMAND)) * STEP, columns), workers=1)
    assert result.verdict == "ok" and result.effects == (), (result.effects, result.reasons)
    assert any("outlier" in note for note in result.notes)
    assert off(result).max() < 4.5, result.parameters
    assert result.parameters["R"].standard_error < 0.01 * MOTOR["R"]
