"""What no effect explains ends in time, doubtful, with what was found until then."""

import numpy as np
import pytest
from fine_motor import FINE, MOTOR, bench

from estimator import estimate_parameters
from estimator.fitting import effort
from estimator.fmus.probe import bundled_model

LEVELS = np.repeat([0.0, 6.0, 2.0, 9.0, 4.0], 150)


@pytest.mark.parametrize("samples", [1, effort.MOST_SAMPLES])
def test_a_search_without_end_is_ended_and_told(monkeypatch, samples):
    """Recordings that have what is not known took more than 150 s; the same ones come to their end in tens."""
    monkeypatch.setattr(effort, "MOST_SAMPLES", samples)
    monkeypatch.setattr(effort, "LEAST_CANDIDATES", 60)
    late = 3 * FINE // 2
    recording = bench(LEVELS, np.repeat(LEVELS, FINE), 0, late=late, more=0.05)
    result = estimate_parameters(recording, workers=1)
    ended = any("was ended before all was tried" in reason for reason in result.reasons)
    assert ended == (samples == 1), result.reasons
    assert result.verdict == ("doubtful" if ended else "ok") and result.parameters.keys() >= MOTOR.keys()


def test_steps_with_events_cost_several_plain_ones():
    """Dry friction that catches within a step: by plain steps half a minute was more than seven minutes."""
    models = ("dc_motor", "dc_motor_geared", "dc_motor_friction", "dc_motor_drive")
    assert [bundled_model(name).has_events for name in models] == [False, False, True, True]


def test_of_an_fmu_of_others_the_time_counts_and_of_a_bundled_one_what_is_the_same_everywhere(monkeypatch, tmp_path):
    """An FMU of 1 ms a step would take hours for what a bundled one simulates in seconds."""
    monkeypatch.setattr(effort, "MOST_SECONDS", 1e-3)
    recording = bench(LEVELS, np.repeat(LEVELS, FINE), 0, late=3 * FINE // 2, more=0.05)
    copied = tmp_path / "theirs.fmu"
    copied.write_bytes(bundled_model("dc_motor").path.read_bytes())
    ended = {}
    for fmu in ("dc_motor", copied):
        found = estimate_parameters(recording, fmu=fmu, workers=1)
        ended[fmu] = any("was ended before all was tried" in reason for reason in found.reasons)
    assert ended == {"dc_motor": False, copied: True}
