"""A current that is shown late beside a voltage whose sensor has noise: both are told, at any part of a sample."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, bench, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMAND = np.repeat([0.0, 5.0, 9.0], [100, 350, 350])


@pytest.mark.parametrize("rows", [2.6, pytest.param(1.3, marks=pytest.mark.full)])
def test_noise_of_a_logged_voltage_is_told_behind_a_current_that_is_late(rows):
    """What the noise would do came 2.6 rows too early in the column that tells it: drops and overshoots were told."""
    recording = bench(COMMAND, np.repeat(COMMAND, FINE), 1, late=round(rows * FINE), noise=0.1)
    result = estimate_parameters(recording, workers=1)
    assert any("voltage's noise does not reach the motor" in note for note in result.notes), result.notes
    assert result.chain["delay of i"].value == pytest.approx(
        rows * 1e-3, abs=5 * result.chain["delay of i"].standard_error
    )
    assert result.verdict == "ok", result.reasons
    assert off(result).max() < 4.5, (result.parameters, MOTOR)
