"""What a figure shows between the samples of a recording: the simulation on a finer grid."""

from pathlib import Path

import numpy as np
import pytest

from estimator.cases.case import read_case
from estimator.estimating.estimate import estimate
from estimator.fmus.simulate import simulate
from estimator.judging.shown import FINER

EXAMPLES = Path(__file__).parent.parent / "examples"


def estimated(folder, *, outputs=""):
    """Return the estimate of the example's first second, as for a report."""
    rows = (EXAMPLES / "cml050_step.csv").read_text().splitlines()[:1001]
    (folder / "step.csv").write_text("\n".join(rows) + "\n")
    (folder / "motor.case.toml").write_text(f'{outputs}\n[[recording]]\nfile = "step.csv"\n')
    return estimate(read_case(folder / "motor.case.toml"), workers=1, profile=True)


def test_between_the_samples_stands_what_the_fmu_does_there(tmp_path):
    result = estimated(tmp_path)
    (shown,) = result.comparisons
    h = 1e-3 / FINER
    assert np.allclose(np.diff(shown.fine.time), h) and shown.fine.time[0] < 0.5 < 0.53 < shown.fine.time[-1] < 0.7
    times = np.arange(round(shown.fine.time[-1] / h) + 1) * h
    values = {name: p.value for name, p in result.parameters.items()}
    assert not result.chain
    truth = simulate("dc_motor", parameters=values, inputs={"v": np.where(times > 0.5 - h / 2, 10.5, 0.0)}, times=times)
    for name, signal in shown.fine.simulated.items():
        np.testing.assert_allclose(signal, truth[name][-len(signal) :], atol=1e-9 * np.ptp(signal))


@pytest.mark.parametrize(
    "sensor",
    ['w = { column = "speed", sensor = "mean" }', 'i = { column = "current", average = 4 }\nw = "speed"'],
)
def test_a_mean_passes_through_its_samples(tmp_path, sensor):
    (shown,) = estimated(tmp_path, outputs=f"[outputs]\n{sensor}").comparisons
    for name, signal in shown.fine.simulated.items():
        at_samples = np.isin(np.round(shown.time, 9), np.round(shown.fine.time[::FINER], 9))
        expected = shown.simulated[name][at_samples]
        np.testing.assert_allclose(signal[::FINER][: len(expected)], expected, atol=1e-6 * np.ptp(expected))


def test_a_sensor_that_filters_has_no_finer_grid(tmp_path):
    sensor = 'w = { column = "speed", filter = { butterworth = { order = 1, cutoff = 300 } } }'
    (shown,) = estimated(tmp_path, outputs=f"[outputs]\n{sensor}").comparisons
    assert shown.fine is None
