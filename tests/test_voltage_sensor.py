"""A voltage whose converter stands behind a filter, and a supply that rises as slowly, which is shown as it is."""

import numpy as np
import pytest
from effect_bench import EXCITATIONS, FINE, NOISE, H, driven, lagged, worst
from motors import CML050, held_response

from estimator import estimate_parameters
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.steps_behind_lag import steps_behind_lag

pytestmark = pytest.mark.usefixtures("shared_workers")

TAU = 4e-3  # s


def shown_late(excitation, *, noise=0.02, seed=1):
    """Return a recording whose voltage is shown behind a low-pass, as it reaches no motor."""
    time, _, current, speed = driven(excitation)
    rng = np.random.default_rng(seed)
    voltage = lagged(EXCITATIONS[excitation](time + 1e-9), TAU)[::FINE]
    columns = {"voltage [V]": voltage, "current [A]": current[::FINE], "speed [rad/s]": speed[::FINE]}
    deviations = (noise, *NOISE.values())
    noisy = {k: y + s * rng.standard_normal(len(y)) for s, (k, y) in zip(deviations, columns.items(), strict=True)}
    return recording_from_arrays("bench", time[::FINE], noisy)


@pytest.mark.parametrize("excitation", ["step", pytest.param("two levels", marks=pytest.mark.full), "reversal"])
def test_steps_behind_the_low_pass_of_their_sensor_are_found(excitation):
    """R was half and L a hundredth, told as a supply that sags; of long recordings there was no answer."""
    found = estimate_parameters(shown_late(excitation), workers=1)
    assert found.verdict == "ok" and worst(found) < 4.5, (worst(found), found.reasons)
    assert "voltage sensor lag" in found.effects
    assert any("4 ms" in note or "3.9" in note or "4.0" in note for note in found.notes if "sensor" in note)


def test_a_supply_that_rises_as_slowly_is_shown_as_it_is():
    time = np.arange(round(0.8 / H) * FINE + 1) * H / FINE
    voltage = lagged(np.where(time >= 0.1, CML050.voltage, 0.0), TAU)
    shown = held_response(CML050, voltage, step=H / FINE)[::FINE]
    rng = np.random.default_rng(2)
    noise = rng.standard_normal((len(shown), 3)) * [0.02, *NOISE.values()]
    columns = {"voltage [V]": voltage[::FINE], "current [A]": shown[:, 0], "speed [rad/s]": shown[:, 1]}
    noisy = {k: y + e for (k, y), e in zip(columns.items(), noise.T, strict=True)}
    found = estimate_parameters(recording_from_arrays("bench", time[::FINE], noisy), workers=1)
    assert "voltage sensor lag" not in found.effects
    for name, p in found.parameters.items():
        assert abs(p.value - getattr(CML050, name)) < 4.5 * p.standard_error, name


def exponentials(levels, *, rows, tau, begins=0.4, noise=0.0, seed=0):
    """Return what a low-pass of `tau` rows shows of levels, each for so many rows, and begun within a row."""
    k = np.arange(rows * len(levels), dtype=float)
    v = np.full(len(k), float(levels[0]))
    for j in range(1, len(levels)):
        v += (levels[j] - levels[j - 1]) * -np.expm1(-np.maximum(k - rows * j - begins, 0.0) / tau)
    return v + noise * np.random.default_rng(seed).standard_normal(len(k))


@pytest.mark.parametrize("tau", [1.3, 4.0, 15.0])
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_levels_edges_and_the_time_constant_are_read_off(tau, noise):
    levels = [0.0, 6.0, 10.0, -4.0]
    found = steps_behind_lag(exponentials(levels, rows=300, tau=tau, noise=noise), 1e-3)
    assert found.tau == pytest.approx(1e-3 * tau, rel=0.01)
    for j, level in enumerate(levels):
        np.testing.assert_allclose(found.levels[300 * j + 1 : 300 * (j + 1) - 1], level, atol=5 * noise + 1e-3)
    at = 300 * np.arange(1, 4)
    means = np.array(levels[1:]) - 0.4 * np.diff(levels)
    assert np.all(np.abs(found.levels[at] - means) < 5 * np.abs(found.errors[at]).max(axis=1) + 1e-3)


@pytest.mark.parametrize(
    "v",
    [
        np.zeros(400),
        np.r_[np.zeros(100), np.full(300, 10.0)],  # a step
        np.r_[np.zeros(100), np.linspace(0, 10, 40), np.full(260, 10.0)],  # a ramp
        10 * np.sin(np.arange(400) / 20),
        exponentials([0.0, 10.0], rows=20, tau=8.0),  # it has not settled
        np.convolve(exponentials([0.0, 10.0], rows=300, tau=8.0), np.ones(12) / 12, "full")[:600],
    ],
    ids=["none", "step", "ramp", "sine", "unsettled", "two filters"],
)
def test_what_is_no_exponential_that_begins_at_once_is_left_as_it_is(v):
    assert steps_behind_lag(v, 1e-3) is None
    assert steps_behind_lag(v + 0.01 * np.random.default_rng(1).standard_normal(len(v)), 1e-3) is None
