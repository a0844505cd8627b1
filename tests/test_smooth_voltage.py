"""Voltages that move smoothly: on lines between their rows, noisy, and from the first row on."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estimator import estimate_parameters, recording_from_arrays
from estimator.cases.case import case_for_recording, read_case
from estimator.explaining.interpretations import interpretations
from estimator.fmus.fmu import describe
from estimator.plans.planning import plan_case
from estimator.recordings.excitation import find_excitation
from estimator.recordings.smooth_inputs import jumps, moves_smoothly, smoothed

pytestmark = pytest.mark.usefixtures("shared_workers")

MOTOR = {"R": 3.1, "K": 0.035, "L": 2.5e-3, "J": 2.5e-5, "B": 2e-5}
H, ROWS = 1e-3, 3000
TIMES = np.arange(ROWS) * H
CORNERS = [0.0, 0.3, 0.5, 1.2, 1.4, 2.0, 2.2, 3.0], [0.0, 0.0, 10.0, 10.0, -10.0, -10.0, 0.0, 0.0]
SIGNALS = {
    "trapezoid": lambda t: np.interp(t, *CORNERS),
    "sine": lambda t: 8 * np.sin(2 * np.pi * 5 * t),
    "soft step": lambda t: 10 * (1 - np.exp(-np.maximum(t - 0.3, 0) / 0.01)),
    "multisine": lambda t: 3 * np.sin(2 * np.pi * 1.5 * t) + 3 * np.sin(2 * np.pi * 7.5 * t + 1),
}


def response(voltage, times, start=(0.0, 0.0)):
    """Return current and speed, (n,) each, by a voltage that is a function of time."""
    r, k, inductance, j, b = MOTOR.values()

    def slope(t, x):
        return [(voltage(t) - r * x[0] - k * x[1]) / inductance, (k * x[0] - b * x[1]) / j]

    return solve_ivp(slope, (times[0], times[-1]), start, t_eval=times, rtol=1e-8, atol=1e-9, max_step=H).y


def measured(kind, seed, *, noise, first=0):
    rng, voltage = np.random.default_rng(seed), SIGNALS[kind]
    i, w = response(voltage, TIMES) + rng.standard_normal((2, ROWS)) * [[0.01], [0.3]]
    v = voltage(TIMES) + noise * rng.standard_normal(ROWS)
    columns = {"voltage [V]": v[first:], "current [A]": i[first:], "speed [rad/s]": w[first:]}
    return recording_from_arrays(kind, TIMES[first:] - TIMES[first], columns)


def worst(result):
    return max(abs(result.parameters[n].value - x) / result.parameters[n].standard_error for n, x in MOTOR.items())


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        ("trapezoid", 3),
        ("soft step", 1),
        *(pytest.param(*case, marks=pytest.mark.full) for case in (("sine", 3), ("trapezoid", 6), ("trapezoid", 8))),
    ],
)
def test_a_measured_voltage_that_moves_smoothly_is_on_lines_and_its_noise_moves_no_motor(kind, seed):
    """By other seeds a delay of a part of a row is a rival, with another L: doubtful then, and within the errors."""
    result = estimate_parameters(measured(kind, seed, noise=0.02), workers=1)
    assert result.verdict == "ok", result.reasons
    assert worst(result) < 4.5
    assert result.parameters["L"].standard_error < 0.1 * MOTOR["L"]
    notes = " ".join(result.notes)
    assert "v on a line" in notes and "noise does not reach the motor" in notes


@pytest.mark.parametrize(
    "kind", ["soft step", *(pytest.param(k, marks=pytest.mark.full) for k in SIGNALS if k != "soft step")]
)
def test_the_noise_of_a_smooth_voltage_is_told_to_a_part_of_it(kind):
    rng, v = np.random.default_rng(2), SIGNALS[kind](TIMES)
    noise = 0.02 * rng.standard_normal(ROWS)
    assert moves_smoothly(v) and moves_smoothly(v + noise)
    left = smoothed(v + noise).signal - v
    assert np.std(left) < 0.45 * np.std(noise) and np.max(np.abs(left)) < 5 * np.std(noise)


def test_what_goes_from_level_to_level_does_not_move_smoothly():
    rng = np.random.default_rng(3)
    step, random = 10.0 * (TIMES > 0.3), rng.choice([3.0, 9.0], ROWS // 20).repeat(20)
    for v in (step, random, rng.standard_normal(ROWS)):
        assert not moves_smoothly(v) and not moves_smoothly(v + 0.02 * rng.standard_normal(ROWS))
    assert not moves_smoothly(np.full(ROWS, 5.0))


@pytest.mark.full  # a motion before the voltage is asked in test_starting_motion.py
def test_a_motor_moves_already_where_a_recording_begins_within_a_smooth_signal():
    result = estimate_parameters(measured("multisine", 5, noise=0.005, first=700), workers=1)
    assert worst(result) < 4.5 and result.parameters["L"].standard_error < 0.2 * MOTOR["L"]
    assert "motion before the voltage" in result.chain and not any("run in" in note for note in result.notes)


def test_a_motor_that_turns_steadily_by_a_count_or_two_a_row_runs_already():
    """Of coarse counts no row is far from none; all of the first rows are."""
    v = np.where(TIMES < 0.2, 4.0, 7.0)
    i, w = response(lambda t: 4.0 if t < 0.2 else 7.0, TIMES, start=steady(4.0))
    count = 2 * np.pi / (4 * 16) / H
    counted = count * np.diff(np.floor(np.concatenate([[0.0], np.cumsum(w * H)]) / (count * H)))
    rng = np.random.default_rng(6)
    i = i + 0.005 * rng.standard_normal(ROWS)
    assert find_excitation(v, {"i": i, "w": counted}).running
    from_rest = response(lambda t: 4.0 if t < 0.2 else 7.0, TIMES)
    counted = count * np.diff(np.floor(np.concatenate([[0.0], np.cumsum(from_rest[1] * H)]) / (count * H)))
    assert not find_excitation(v, {"i": from_rest[0] + 0.005 * rng.standard_normal(ROWS), "w": counted}).running


def steady(voltage):
    """Return current and speed at a constant voltage."""
    r, k, _, _, b = MOTOR.values()
    w = k * voltage / (r * b + k * k)
    return b * w / k, w


def discharged(t):
    """Return the voltage of a capacitor that is connected at 40 ms, and falls."""
    return np.where(t >= 0.04 - 1e-9, 10.0 * np.exp(-(t - 0.04) / 0.06), 0.0)


def of_capacitor(seed, said=""):
    times, rng = np.arange(200) * 2e-3, np.random.default_rng(seed)
    edge = 20
    after = response(discharged, times[edge:])
    i, w = np.concatenate([np.zeros((2, edge)), after], axis=1) + rng.standard_normal((2, 200)) * [[0.005], [0.2]]
    v = discharged(times) + 0.01 * rng.standard_normal(200)
    return recording_from_arrays("capacitor", times, {"voltage [V]": v, "current [A]": i, "speed [rad/s]": w})


def written_to(file, recording):
    table = np.column_stack([recording.time, *recording.signals.values()])
    np.savetxt(file, table, delimiter=",", header=",".join(["t [s]", *recording.units]), comments="")


@pytest.mark.parametrize("seed", [1, *(pytest.param(k, marks=pytest.mark.full) for k in (2, 3))])
def test_a_measured_voltage_that_jumps_and_falls_is_on_lines_between_its_jumps_or_nobody_can_tell(seed):
    result = estimate_parameters(of_capacitor(seed), workers=1)
    z = [(result.parameters[n].value - x) / result.parameters[n].uncertainty for n, x in MOTOR.items()]
    assert max(map(abs, z)) < 4.5
    assert any("v on a line between its jumps" in text for text in (*result.notes, *result.reasons))


def test_a_voltage_that_is_declared_to_be_linear_between_jumps_is_told_as_exactly_as_a_smooth_one(tmp_path):
    written_to(tmp_path / "capacitor.csv", of_capacitor(4))
    (tmp_path / "discharge.case.toml").write_text(
        '[inputs]\nv = { column = "voltage [V]", between = "linear between jumps" }\n'
        '[[recording]]\nfile = "capacitor.csv"\n'
    )
    result = estimate_parameters(tmp_path / "discharge.case.toml", workers=1)
    assert result.verdict == "ok", result.reasons
    assert worst(result) < 4.5 and result.parameters["K"].uncertainty < 5e-3 * MOTOR["K"]


@pytest.mark.parametrize("way", [0, 1])
def test_what_decides_how_a_voltage_goes_between_its_rows_is_said_as_a_case_file_takes_it(tmp_path, way):
    """The sentence named a key that [inputs] does not have, and who wrote it was refused."""
    written_to(tmp_path / "capacitor.csv", of_capacitor(4))
    case = case_for_recording(tmp_path / "capacitor.csv")
    ways = interpretations(plan_case(case, describe(case.fmu)))
    said = re.search(r"under (\[inputs\]): (.*) or (.*)", ways[way].remedy)
    table, held, other = said.groups()
    lines = [held, held.replace('"held"', other)]
    (tmp_path / "said.case.toml").write_text(f"{table}\n{lines[way]}\n[[recording]]\nfile = 'capacitor.csv'\n")
    case = read_case(tmp_path / "said.case.toml")
    assert len(interpretations(plan_case(case, describe(case.fmu)))) == 1
    assert (case.held, case.jumping) == [(("v",), ()), ((), ("v",))][way]


def test_jumps_are_where_a_voltage_changes_by_far_more_than_beside_and_everywhere_where_it_has_levels():
    rng, rows = np.random.default_rng(4), np.arange(300)
    falls = np.where(rows >= 50, 10 * np.exp(-(rows - 50) / 30), 0.0) + 0.01 * rng.standard_normal(300)
    assert np.flatnonzero(jumps(falls)).tolist() == [50]
    assert not jumps(np.sin(rows / 20)).any()
    swings = np.where(rows >= 50, 10 + 8 * np.sin(rows / 8), 0.0) + 0.01 * rng.standard_normal(300)
    assert moves_smoothly(swings) and np.flatnonzero(jumps(swings)).tolist() == [50]
    levels = np.where(rows >= 50, 10.0, 0.0)
    assert np.flatnonzero(jumps(levels)).tolist() == [50]
    noisy = levels + 0.02 * rng.standard_normal(300)
    assert jumps(noisy)[1:].all()
