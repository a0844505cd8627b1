"""A command that is a wave of a few dozen rows has no noise, and no levels whose noise it could be."""

import numpy as np
import pytest
from motors import CML050, held_response, recording_of

from estimator.estimating.estimate import estimate_recordings
from estimator.recordings.signal_noise import input_noise, is_measured

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP = 1e-3  # s


def wave(rows):
    """Return a sine of so many rows a period, V; beside its crests of some twenty rows others change by an edge's."""
    return np.concatenate([np.zeros(30), 8 * np.sin(2 * np.pi * np.arange(4 * rows) / rows)])


@pytest.mark.parametrize("rows", [20, 40, 54, 60, 200])
def test_a_smooth_command_is_not_measured(rows):
    assert not is_measured(wave(rows))
    noisy = wave(rows) + 0.05 * np.random.default_rng(1).standard_normal(4 * rows + 30)
    if rows >= 40:
        assert input_noise(noisy) == pytest.approx(0.05, rel=0.35)


@pytest.mark.parametrize(
    ("digit", "noise"),
    [(0.1, 0.0), *(pytest.param(*case, marks=pytest.mark.full) for case in ((0.0, 0.0), (0.01, 0.0), (0.0, 0.02)))],
)
def test_it_is_estimated_as_it_is(case_of, digit, noise):
    """R was 9 to 27 standard errors off, beside seven effects that were not there."""
    command = wave(54)
    shown = held_response(CML050, command, step=STEP)
    logged = np.round(command / digit) * digit if digit else command
    logged = logged + noise * np.random.default_rng(5).standard_normal(len(command))
    recording = recording_of("sine", STEP * np.arange(len(command)), logged, shown, noise=(0.02, 1.0), seed=2)
    (found,) = estimate_recordings([case_of()], [[recording]])
    assert found.verdict == "ok", found.reasons
    for name, truth in CML050.parameters.items():
        parameter = found.parameters[name]
        assert abs(parameter.value - truth) < 4.5 * parameter.standard_error, (name, parameter)
