"""A motor that moves before its voltage, whose motion is no sum: dry friction brakes it, an open circuit does not."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from driven_motor import DrivenMotor
from dry_friction import DryMotor
from motors import CML050, held_response, recording_of

from estimator.cases.case_signals import RunSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining.effects.starting_motion import StartingMotion

pytestmark = pytest.mark.usefixtures("shared_workers")

STEP, FIRST = 1e-3, -60.0  # s; rad/s
VOLTAGE = np.repeat([0.0, 10.5], [200, 600])
DRY = {**CML050.parameters, "friction": 0.012, "stiction": 0.0, "brush": 0.0}


def begun(motor, voltage):
    """Return current and speed, (n, 2), of a motor that turns already; simulated without the project."""
    motor.x = [-motor.p["K"] * FIRST / motor.p["R"], FIRST, 0.0]
    motor.shaft, motor.brushes = -1, 1
    first = motor.x[:2]
    return np.vstack([[first], motor.response(voltage, np.zeros(len(voltage)), step=STEP)[:-1, :2]])


def estimated(case_of, voltage, shown):
    recording = recording_of("bench", STEP * np.arange(len(voltage)), voltage, shown, noise=(0.02, 1.0), seed=1)
    (found,) = estimate_recordings([case_of("cuckoo")], [[recording]])
    return found


def worst(found, truth):
    return max(abs(p.value - truth[name]) / p.standard_error for name, p in found.parameters.items())


def test_dry_friction_brakes_a_motor_that_turns_before_its_voltage(case_of):
    found = estimated(case_of, VOLTAGE, begun(DryMotor(dict(DRY)), VOLTAGE))
    assert set(found.effects) == {"dry friction", "motion before the voltage"}, (found.effects, found.reasons)
    assert found.verdict == "ok" and worst(found, DRY) < 4.5
    speed, friction = found.chain["motion before the voltage"], found.chain["friction"]
    assert abs(speed.value - FIRST) < 4.5 * speed.standard_error < 5
    assert abs(friction.value - DRY["friction"]) < 4.5 * friction.standard_error < 0.3 * DRY["friction"]


def test_a_recording_that_the_case_says_begins_at_rest_has_no_motion_before_its_voltage(case_of):
    def at_rest(method):
        return dataclasses.replace(case_of(method), runs=(RunSpec(begin="rest"),))

    for case, known in ((at_rest, set()), (case_of, {"motion before the voltage"})):
        shown = begun(DryMotor({**DRY, "friction": 0.0}), VOLTAGE)
        found = estimated(case, VOLTAGE, shown)
        assert set(found.effects) & {"motion before the voltage"} == known, found.effects
        assert known or found.verdict != "ok"


def turning(first, rows, voltage):
    """Return current and speed, (n, 2), of a motor that coasts for so many rows, by B alone, and is driven then."""
    truth = CML050.parameters
    driven = DryMotor({**truth, "friction": 0.0, "stiction": 0.0, "brush": 0.0})
    coasting = first * np.exp(-truth["B"] / truth["J"] * STEP * np.arange(rows + 1))
    way = 1 if coasting[-1] > 0 else -1
    driven.x, driven.shaft, driven.brushes = [0.0, float(coasting[-1]), 0.0], way, 1
    rest = driven.response(voltage[rows:], np.zeros(len(voltage) - rows), step=STEP)[:-1, :2]
    return np.vstack([np.column_stack([np.zeros(rows + 1), coasting]), rest])


@pytest.mark.parametrize(
    ("first", "rows"),
    [(-120.0, 30), *(pytest.param(*case, marks=pytest.mark.full) for case in ((FIRST, 200), (90.0, 30)))],
)
def test_a_motor_whose_circuit_is_open_coasts_before_its_voltage(first, rows, case_of):
    """Behind one level of the voltage an offset of the speed explains it as well, by another motor: half of it, ok."""
    found = estimated(case_of, VOLTAGE[200 - rows :], turning(first, rows, VOLTAGE[200 - rows :]))
    assert {"coasting", "motion before the voltage"} <= set(found.effects), (found.effects, found.reasons)
    assert "offset" not in found.effects and worst(found, CML050.parameters) < 4.5
    assert found.parameters["K"].standard_error < 0.01 * found.parameters["K"].value
    assert found.chain["motion before the voltage"].value == pytest.approx(first, abs=2.0)


@pytest.mark.full
def test_a_motor_that_turns_when_it_is_switched_on_backwards_is_not_told_by_an_offset(case_of):
    voltage = np.full(600, 10.5)
    found = estimated(case_of, voltage, turning(-120.0, 0, voltage))
    assert worst(found, CML050.parameters) < 4.5
    assert found.verdict == "doubtful" or "motion before the voltage" in found.effects


@pytest.mark.full
def test_a_recording_at_rest_whose_sensor_has_an_offset_does_not_move_twice(case_of):
    """It looks as if it coasted: its motion was simulated and, as behind an open circuit, in columns, too."""
    voltage = np.where(np.arange(1500) >= 300, 10.5, 0.0)
    rows, offset = np.arange(800), 5.0
    still = recording_of("rest", STEP * rows, 0.0 * rows, np.tile([0.0, offset], (800, 1)), noise=(0.02, 1.0), seed=1)
    shown = held_response(CML050, voltage, step=STEP)
    step = recording_of("step", STEP * np.arange(1500), voltage, shown, noise=(0.02, 1.0), seed=1)
    (found,) = estimate_recordings([case_of("cuckoo")], [[still, step]])
    assert found.chain["offset w rest"].value == pytest.approx(offset, abs=0.2)
    assert worst(found, CML050.parameters) < 4.5


@pytest.mark.parametrize("noise", [0.01, pytest.param(0.0, marks=pytest.mark.full)])
def test_a_motor_that_turns_before_a_noisy_voltage_is_told_to(noise, case_of):
    """The noise of the first row, 9 mV, was taken for the voltage at which the motor runs: R was known to 45 %."""
    rng = np.random.default_rng(1)
    motor = DryMotor({**CML050.parameters, "friction": 0.0, "stiction": 0.0, "brush": 0.0})
    shown = begun(motor, VOLTAGE[190:])
    logged = VOLTAGE[190:] + noise * rng.standard_normal(len(VOLTAGE) - 190)
    assert noise == 0 or logged[0] != 0
    found = estimated(case_of, logged, shown)
    assert "motion before the voltage" in found.effects and found.verdict == "ok", (found.effects, found.reasons)
    for name, value in CML050.parameters.items():
        assert abs(found.parameters[name].value - value) < 4.5 * found.parameters[name].standard_error, name


def test_of_a_model_that_is_driven_by_something_else_no_coast_is_asked():
    rows = np.zeros(100)
    o = SimpleNamespace(inputs={"u": rows}, outputs={"i": rows, "w": rows + 1.0}, is_underway=False, recording=None)
    o.recording = SimpleNamespace(name="plant")
    assert StartingMotion().at_first_sight(SimpleNamespace(observed=[o])) == {}


COUNT = 2 * np.pi / 10000  # rad


def differenced(x):
    """Return current and speed, (n - 1, 2), of states, (n, 3): of an encoder's counts, differenced from row to row."""
    return np.column_stack([x[1:, 0], np.diff(np.floor(x[:, 2] / COUNT + 0.3)) * COUNT / STEP])


def of_coast_and_sine(*, coasts=1.0):
    """Return a recording that ends with an open circuit, and one that begins within a sine."""
    found = []
    steps = np.repeat([0.0, 10.5, 0.0], [100, 600, 500])
    sine = 6 + 4 * np.sin(2 * np.pi * 1.3 * STEP * np.arange(1500))
    for name, voltage, first in (("coast", steps, 1), ("sine", sine, 400)):
        motor = DrivenMotor({**CML050.parameters, "coasts": coasts})
        x = np.vstack([np.zeros(3), motor.response(voltage, np.zeros(len(voltage)), step=STEP)[:-1, :3]])
        shown = differenced(x)[first - 1 :]
        times = STEP * np.arange(len(shown))
        found.append(recording_of(name, times, voltage[first:], shown, noise=(0.02, 0.0), seed=first))
    return found


def test_a_motor_that_runs_in_the_first_row_is_told_to_beside_one_that_coasts(case_of):
    """The open circuit of one recording forbade any motion before the voltage of the others: all were refused."""
    (found,) = estimate_recordings([case_of("cuckoo")], [of_coast_and_sine()])
    assert found.verdict == "ok" and worst(found, CML050.parameters) < 4.5, (found.reasons, found.parameters)
    assert {"coasting", "motion before the voltage"} <= set(found.effects)
    assert found.chain["motion before the voltage sine#1"].standard_error > 0


def test_counts_over_the_interval_before_the_first_row_are_not_compared(case_of):
    """They were held against none of a motor at rest: an outlier of the whole speed, or rows lost at the beginning."""
    (found,) = estimate_recordings([case_of("cuckoo")], [of_coast_and_sine()[1:]])
    assert found.verdict == "ok" and worst(found, CML050.parameters) < 4.5, (found.reasons, found.parameters)
    assert set(found.effects) == {"motion before the voltage"}
    assert not any("outlier" in note for note in found.notes), found.notes
