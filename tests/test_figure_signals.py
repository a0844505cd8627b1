"""What a figure shows between the samples of a recording: the simulation on a finer grid."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from motors import CML050, held_response, recording_of, step_recording, write_recording

from estimator.cases.case import read_case
from estimator.estimating.estimate import estimate
from estimator.fmus.simulate import simulate
from estimator.judging.figure_signals import FINER

pytestmark = pytest.mark.usefixtures("shared_workers")

EXAMPLES = Path(__file__).parent.parent / "examples"


def estimated(folder, *, outputs="", recording=None):
    """Return the estimate of a recording, by default the example's first second, as for a report."""
    if recording is None:
        rows = (EXAMPLES / "cml050_step.csv").read_text().splitlines()[:1001]
        (folder / "step.csv").write_text("\n".join(rows) + "\n")
    else:
        write_recording(recording, folder / "step.csv")
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


def test_between_the_samples_of_a_warmer_recording_stands_what_its_own_resistance_does(tmp_path):
    """It was simulated by that of the first one, which lies elsewhere, and so was not shown."""
    warm = dataclasses.replace(CML050, R=CML050.R * (1 + 0.00393 * 50))
    lines = []
    for motor, temperature in ((CML050, 25), (warm, 75)):
        recording = step_recording(motor, noise=(0.02, 1.0), seed=temperature, lead=0.2, duration=0.6)
        write_recording(recording, tmp_path / f"at_{temperature}.csv")
        lines += ["[[recording]]", f'file = "at_{temperature}.csv"', f"temperature = {temperature}"]
    (tmp_path / "motor.case.toml").write_text("\n".join(lines))
    result = estimate(read_case(tmp_path / "motor.case.toml"), workers=1, profile=True)
    assert result.verdict == "ok" and all(compared.fine is not None for compared in result.comparisons)


def averaged(*, mean_speed=False, currents=1, offset=0.0):
    """Return a step of CML050 whose speed is the mean since the sample before, its current that of so many samples.

    The offset is the speed's, in rad/s.
    """
    fine = np.where(np.arange(10_001) >= 5000, 10.5, 0.0)  # at 10 kHz
    i, w = held_response(CML050, fine, step=1e-4).T
    if mean_speed:
        w[10:] = np.convolve(w, [0.05, *[0.1] * 9, 0.05], mode="valid")
    i = np.mean([np.concatenate([np.zeros(k), i[::10][: 1001 - k]]) for k in range(currents)], axis=0)
    return recording_of(
        "step", 1e-3 * np.arange(1001), fine[::10], np.column_stack([i, w[::10] + offset]), noise=(0.02, 1.0), seed=1
    )


@pytest.mark.parametrize(
    ("sensor", "truth"),
    [
        ('i = "current"\nw = { column = "speed", sensor = "mean" }', {"mean_speed": True}),
        ('i = { column = "current", average = 4 }\nw = "speed"', {"currents": 4}),
    ],
)
def test_a_mean_passes_through_its_samples(tmp_path, sensor, truth):
    result = estimated(tmp_path, outputs=f"[outputs]\n{sensor}", recording=averaged(**truth))
    assert result.verdict == "ok" and not result.chain
    (shown,) = result.comparisons
    for name, signal in shown.fine.simulated.items():
        at_samples = np.isin(np.round(shown.time, 9), np.round(shown.fine.time[::FINER], 9))
        expected = shown.simulated[name][at_samples]
        np.testing.assert_allclose(signal[::FINER][: len(expected)], expected, atol=1e-6 * np.ptp(expected))


@pytest.mark.parametrize(("offset", "is_small"), [(1.0, True), (40.0, False)])
def test_beside_a_small_effect_the_finer_grid_passes_through_the_samples_and_beside_a_large_one_is_none(
    tmp_path, offset, is_small
):
    result = estimated(tmp_path, recording=averaged(offset=offset))
    assert set(result.chain) == {"offset w"}
    (shown,) = result.comparisons
    assert (shown.fine is not None) == is_small
    for name, signal in shown.fine.simulated.items() if is_small else ():
        at_samples = np.isin(np.round(shown.time, 9), np.round(shown.fine.time[::FINER], 9))
        np.testing.assert_allclose(signal[::FINER], shown.simulated[name][at_samples], atol=1e-6 * np.ptp(signal))


def test_a_sensor_that_filters_has_no_finer_grid(tmp_path):
    sensor = 'w = { column = "speed", filter = { butterworth = { order = 1, cutoff = 300 } } }'
    (shown,) = estimated(tmp_path, outputs=f"[outputs]\n{sensor}").comparisons
    assert shown.fine is None
