"""A current that is shown late beside a voltage whose sensor has noise: both are told, at any part of a sample."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, bench, off

from estimator import estimate_parameters

pytestmark = pytest.mark.usefixtures("shared_workers")

COMMAND = np.repeat([0.0, 5.0, 9.0], [100, 350, 350])


@pytest.mark.full  # at one part of a sample: test_effects.py
@pytest.mark.parametrize("rows", [2.6, 1.3])
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


@pytest.mark.parametrize("rows", [0.5, pytest.param(-0.26, marks=pytest.mark.full)])
def test_all_of_the_noise_of_a_logged_voltage_is_told_where_it_acts_between_rows(rows):
    """Fits of a model that it drives told delays of -1.1 ms, drops of the brushes and filters for it."""
    parts = np.arange(len(COMMAND) * FINE)
    fine = np.interp(parts - round(rows * FINE), parts, np.repeat(COMMAND, FINE))
    result = estimate_parameters(bench(COMMAND, fine, 1, noise=0.1), workers=1)
    told = [note for note in result.notes if "voltage's noise does not reach the motor" in note]
    assert len(told) == 1 and 95 <= float(told[0].split("(")[1].split()[0]) <= 105, result.notes
    assert result.chain["delay"].value == pytest.approx(rows * 1e-3, abs=5 * result.chain["delay"].standard_error)
    assert result.verdict == "ok", result.reasons
    assert off(result).max() < 4.5, (result.parameters, MOTOR)


@pytest.mark.full
def test_changes_that_come_faster_than_the_current_settles_tell_no_delays_of_their_own():
    """Of levels that last 26 to 59 ms behind one delay of 18.6 ms each was told its own, 0 to 18 ms."""
    lengths = [100, 31, 36, 35, 26, 57, 27, 42, 28, 31, 59, 150]
    command = np.repeat(np.where(np.arange(len(lengths)) % 2, 8.0, -4.0) * (np.arange(len(lengths)) > 0), lengths)
    late = round(18.6 * FINE)
    voltage = np.concatenate([np.zeros(late), np.repeat(command, FINE)])[: len(command) * FINE]
    result = estimate_parameters(bench(command, voltage, 1), workers=1)
    assert not any("each by its own" in note for note in result.notes), result.notes
    assert result.chain["delay"].value == pytest.approx(18.6e-3, abs=5 * result.chain["delay"].standard_error)
    assert result.verdict == "ok" and off(result).max() < 4.5, (result.reasons, result.parameters)
