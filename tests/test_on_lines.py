"""A noisy input that goes along a few lines: a ramp of a measured voltage."""

import numpy as np
import pytest

from estimator import estimate_parameters, simulate_fmu
from estimator.recordings.on_lines import on_lines
from estimator.recordings.smooth_inputs import moves_smoothly, smoothed

SEEDS = 20


def ramp(rows, first, last):
    """Return a voltage, (n,), that rises from 0 to 12 V between two rows, which need not be whole."""
    return np.interp(np.arange(rows), [0, first, last, rows], [0.0, 0.0, 12.0, 12.0])


@pytest.mark.parametrize(
    ("rows", "noise"),
    [(80, 0.18), *(pytest.param(*case, marks=pytest.mark.full) for case in ((250, 0.18), (2300, 0.016)))],
)
def test_what_is_told_of_lines_is_off_by_as_much_as_is_said(rows, noise):
    """Over 20 noises, of six numbers each: a mean of 120 squares is 0.45 to 1.7 all but once in 10⁵ times."""
    true, rng = ramp(rows, 0.1 * rows + 0.3, 0.6 * rows + 0.7), np.random.default_rng(rows)
    squares = []
    for _ in range(SEEDS):
        found = on_lines(true + noise * rng.standard_normal(rows), noise)
        assert found is not None and found.errors.shape == (rows, 6)
        off = found.signal - true
        squares.append(float(off @ off) / noise**2 / 6)
    assert 0.45 < np.mean(squares) < 1.7


def test_what_bends_is_on_no_lines_and_what_has_no_noise_neither():
    rng, rows = np.random.default_rng(1), np.arange(400)
    wave = 12 * np.sin(2 * np.pi * rows / 133)
    assert on_lines(wave + rng.normal(0, 0.02, 400), 0.02) is None
    assert on_lines(ramp(400, 40, 270), 0.0) is None
    assert smoothed(wave + rng.normal(0, 0.02, 400)).errors is None


def test_few_rows_hold_few_corners():
    """Where corners leave no place for another the search ended in an error."""
    rng = np.random.default_rng(3)
    for rows in (10, 11, 13, 15, 19, 25):
        for shape in (ramp(rows, 0.3 * rows, 0.6 * rows), 12 * np.sin(np.arange(rows)), rng.normal(0, 5, rows)):
            on_lines(shape + rng.normal(0, 0.01, rows), 0.01)


def test_a_ramp_moves_smoothly_though_its_noise_hides_what_it_does_from_row_to_row():
    rng = np.random.default_rng(2)
    noise = rng.normal(0, 0.016, 2300)
    assert moves_smoothly(ramp(2300, 200, 1400) + noise)  # by 0.01 V a row
    assert not moves_smoothly(np.where(np.arange(2300) < 700, 1.0, 1.05) + noise)
    assert not moves_smoothly(5.0 + noise)


@pytest.mark.usefixtures("shared_workers")
@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in range(2, 7))])
def test_a_ramp_whose_voltage_is_measured_is_no_load_step_and_no_current_limit(seed):
    """L was 52 % off, 17 standard errors, after 48 s: what local cubics leave of noise was explained by the machine."""
    motor = {"R": 1.47, "K": 0.69, "L": 5.2e-3, "J": 2.2e-3, "B": 6e-4}
    rng, times = np.random.default_rng(seed), 1e-3 * np.arange(254)
    v = 7.5 * ramp(254, 30, 150)
    fine = np.interp(np.arange(254 * 10) / 10, np.arange(254), v)  # it rises between the rows, too
    motion = simulate_fmu("dc_motor", times=1e-4 * np.arange(2540), inputs={"v": fine}, parameters=motor)
    i, w = (motion[n][::10] + rng.normal(0, deviation, 254) for n, deviation in (("i", 0.05), ("w", 0.1)))
    result = estimate_parameters(time=times, v=v + rng.normal(0, 0.18, 254), i=i, w=w, workers=1)
    off = {n: (result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in motor.items()}
    assert max(map(abs, off.values())) < 4.5, (off, result.reasons)
    assert set(result.effects) <= {"voltage noise", "inputs between the rows"}, result.effects
