"""The linear response of a motor whose drive opens the circuit, against a step-by-step solution in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from driven_motor import DrivenMotor
from scipy.linalg import expm

from estimator import estimate_parameters, recording_from_arrays
from estimator.fitting.motor_response import COASTS, free_motion, late_response, pulse_response, response
from estimator.noise.clock import Clock
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec
from estimator.recordings.filters import LowPass
from estimator.recordings.sensors import Sensor
from estimator.stepping import layout

MOTOR = {"R": 2.0, "K": 0.05, "L": 3e-3, "J": 2e-5, "B": 4e-5}
STEP = 1e-3
VOLTAGE = np.r_[np.zeros(20), np.full(60, 6.0), np.zeros(50), np.full(40, -4.0), np.zeros(30)]


def fit_of(coasts, late=0.0, motor=MOTOR, *, speed=layout.IDENTITY, chains=None, linear=(), jumps=None):
    names = (*MOTOR, COASTS, "delay of i")
    delay = SimpleNamespace(name="delay of i", place=SensorPlace("delay", None, "i"), act=None, output="")
    n = len(VOLTAGE)
    simulator = SimpleNamespace(
        plan=SimpleNamespace(
            fixed={}, observed=[None], chains=chains or {}, sensors={"i": layout.IDENTITY, "w": speed},
            case=SimpleNamespace(linear=linear),
        ),
        names=names,
        index={name: k for k, name in enumerate(names)},
        outputs=("i", "w"), observed=[SimpleNamespace(inputs={"v": VOLTAGE}, jumps=jumps or {})],
        nuisances=(delay,), rows=n,
        clocks=(Clock(STEP * np.arange(n), slice(0, n)),), inputs=lambda name: VOLTAGE,
    )  # fmt: skip
    values = np.array([*motor.values(), coasts, late])
    value = dict(zip(names, values.tolist(), strict=True)).__getitem__
    fit = SimpleNamespace(simulator=simulator, values=values, value=value, delay=lambda e: 0.0)
    fit.once = lambda told: told(fit)
    return fit


def solved(voltage, torque, coasts):
    """Return current and speed, (n, 2), row after row: closed by the matrix exponential, open without current."""
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((4, 4))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance, 0], [k / j, -b / j, 0, -1 / j]]
    closed = expm(whole * STEP)[:2]
    x, shown = np.zeros(2), []
    for row, (v, t) in enumerate(zip(voltage, torque, strict=True)):
        if coasts and VOLTAGE[row] == 0:
            x[0] = 0.0
            shown.append(x.copy())
            x[1] = (x[1] + t / b) * np.exp(-b / j * STEP) - t / b
        else:
            shown.append(x.copy())
            x = closed @ np.r_[x, v, t]
    return np.array(shown)


@pytest.mark.parametrize("coasts", [0.0, 1.0])
def test_a_change_of_voltage_or_torque_moves_current_and_speed_as_the_equations_say(coasts):
    t = STEP * np.arange(len(VOLTAGE))
    drop, load = -np.sign(VOLTAGE), 1e-3 * np.cos(40 * t)
    none = np.zeros(len(t))
    both = response(fit_of(coasts), voltage=drop, torque=load)
    np.testing.assert_allclose(both, solved(drop, load, coasts), rtol=1e-9, atol=1e-9)
    two = response(fit_of(coasts), voltage=np.column_stack([drop, 2 * drop]))
    np.testing.assert_allclose(two[:, :, 1], 2 * solved(drop, none, coasts), rtol=1e-9, atol=1e-9)


def turned(voltage, torque, coasts):
    """Return by how much the shaft has turned, (n,), before each row: by sums over a fiftieth of it."""
    r, k, inductance, j, b = MOTOR.values()
    angle, x, shown = 0.0, np.zeros(2), []
    whole = np.zeros((4, 4))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance, 0], [k / j, -b / j, 0, -1 / j]]
    part = STEP / 50
    closed = expm(whole * part)[:2]
    for row, (v, t) in enumerate(zip(voltage, torque, strict=True)):
        shown.append(angle)
        opens = coasts and VOLTAGE[row] == 0
        x[0] *= not opens
        for _ in range(50):
            speed = x[1]
            if opens:
                x[1] = (x[1] + t / b) * np.exp(-b / j * part) - t / b
            else:
                x = closed @ np.r_[x, v, t]
            angle += 0.5 * (speed + x[1]) * part
    return np.array(shown)


@pytest.mark.parametrize("late", [0.0, 0.4])
@pytest.mark.parametrize("coasts", [0.0, 1.0])
def test_a_speed_by_counts_is_shown_as_its_mean_since_the_row_before(coasts, late):
    """It was shown as it is at the row, half a row early: an effect of 80 rad/s was off by 6 counts of an encoder."""
    drop, load = -np.sign(VOLTAGE), 1e-3 * np.cos(40 * STEP * np.arange(len(VOLTAGE)))
    fit = fit_of(coasts, STEP * late, speed=layout.MEAN)
    expected = np.diff(turned(drop, load, coasts), prepend=0.0) / STEP
    shown = response(fit, voltage=drop, torque=load)
    np.testing.assert_allclose(shown[:, 1], expected, rtol=1e-4, atol=1e-4 * np.max(np.abs(expected)))


def test_a_change_passes_through_the_mean_the_filter_and_the_gain_that_are_declared():
    spec = ChainSpec(average=3, filters=(LowPass("butterworth", 2, 60.0),), gain=0.5, offset=7.0)
    drop = -np.sign(VOLTAGE)
    plain = response(fit_of(0.0, speed=layout.MEAN), voltage=drop)[:, 1]
    shown = response(fit_of(0.0, speed=layout.MEAN, chains={"w": spec}), voltage=drop)[:, 1]
    sensor = Sensor(average=3, sections=spec.sections(STEP), gain=0.5)
    np.testing.assert_allclose(shown, [sensor.show(x) for x in plain], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("late", [-0.3, 0.4, 1.0, 2.6])
def test_a_voltage_that_is_late_by_parts_of_a_row_acts_as_it_does_between_them(late):
    """By a solution in tenths of rows: of a winding that is faster than a row, shares in time are far off."""
    fast = MOTOR | {"L": 4e-4}
    fit, rows = fit_of(0.0, motor=fast), len(VOLTAGE)
    fit.delay = lambda e: late * STEP
    voltage = np.random.default_rng(1).standard_normal(rows)
    voltage[:1] = voltage[-4:] = 0.0  # what came before the first row, and would come behind the last, is not known
    by = round(10 * late)
    fine = np.concatenate([np.zeros(max(by, 0)), np.repeat(voltage, 10)[max(-by, 0) :], np.zeros(max(-by, 0))])
    r, k, inductance, j, b = fast.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    after, x, shown = expm(whole * STEP / 10)[:2], np.zeros(2), []
    for v in fine[: 10 * rows]:
        shown.append(x)
        x = after @ np.r_[x, v]
    np.testing.assert_allclose(late_response(fit, voltage), np.array(shown)[::10], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("jumps", [False, True])
@pytest.mark.parametrize("late", [0, 2])
def test_a_voltage_on_lines_between_its_jumps_acts_as_it_does_there(late, jumps):
    """It was held over each row: to a noise that changes in every row a winding answers otherwise, and L was off."""
    fast, rng, rows = MOTOR | {"L": 4e-4}, np.random.default_rng(2), len(VOLTAGE)
    voltage = np.append(0.0, rng.standard_normal(rows - 1))
    jumped = (rng.random(rows) < 0.2) & jumps
    fit = fit_of(0.0, motor=fast, linear=("v",), jumps={"v": jumped})
    fit.delay = lambda e: late * STEP
    r, k, inductance, j, b = fast.values()
    whole = np.zeros((4, 4))  # current, speed, voltage, by how much it goes on in the row
    whole[:2, :3], whole[2, 3] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]], 1 / STEP
    over, x, shown = expm(whole * STEP)[:2], np.zeros(2), []
    goes_on = np.append(np.where(jumped[1:], 0.0, np.diff(voltage)), 0.0)
    for own, change in zip(np.r_[np.zeros(late), voltage], np.r_[np.zeros(late), goes_on], strict=True):
        shown.append(x)
        x = over @ np.r_[x, own, change]
    found = late_response(fit, voltage)
    np.testing.assert_allclose(found[: rows - late], np.array(shown)[: rows - late], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("late", [0.0, 0.4, 2.6])
def test_a_pulse_and_a_free_motion_are_shown_as_late_as_their_channel(late):
    """A pulse of 1 V over one row is what a held voltage does; the current was shown without its delay."""
    fit, row = fit_of(0.0, late=late * STEP), 30
    (clock,) = fit.simulator.clocks
    voltage = np.zeros(len(VOLTAGE))
    voltage[row] = 1.0
    pulse = pulse_response(fit, clock, row * STEP, (row + 1) * STEP)
    np.testing.assert_allclose(pulse, response(fit, voltage=voltage), rtol=1e-9, atol=1e-9)
    turned = pulse_response(fit, clock, (row + 1) * STEP, row * STEP)
    np.testing.assert_allclose(turned, -pulse, rtol=1e-9, atol=1e-12)
    r, k, inductance, j, b = MOTOR.values()
    a = np.array([[-r / inductance, -k / inductance], [k / j, -b / j]])
    t = clock.time
    of_current = np.array([expm(a * max(0.0, x - late * STEP))[0] for x in t])  # by 1 A and by 1 rad/s; held before
    of_speed = np.array([expm(a * x)[1] for x in t])
    expected = np.stack([of_current[:, ::-1], of_speed[:, ::-1]], axis=1)
    np.testing.assert_allclose(free_motion(fit, clock), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("late", [0.4, 1.0, 2.6])
def test_an_output_that_is_late_shows_what_was_between_two_rows(late):
    """Of inputs that are held over rows, by a solution in tenths of these."""
    fine = np.repeat(VOLTAGE, 10)
    r, k, inductance, j, b = MOTOR.values()
    whole = np.zeros((3, 3))
    whole[:2] = [[-r / inductance, -k / inductance, 1 / inductance], [k / j, -b / j, 0]]
    step = expm(whole * STEP / 10)[:2]
    x = np.zeros((len(fine) + 1, 2))
    for row, v in enumerate(fine.tolist()):
        x[row + 1] = step @ [*x[row], v]
    at = 10 * np.arange(len(VOLTAGE))
    shown = response(fit_of(0.0, late * STEP), voltage=VOLTAGE)
    np.testing.assert_allclose(shown[:, 0], x[np.maximum(at - round(10 * late), 0), 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(shown[:, 1], x[at, 1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("third", [pytest.param((), marks=pytest.mark.full), (("a step", [0.0, 7.0], 0.0),)])
def test_of_one_set_a_recording_may_coast_and_another_be_braked(third):
    """The bridge that opens at no voltage in one test shorts the motor in the next.

    One that never returns to none has no such switch: it was set to the value of R there, which an FMU refuses.
    """
    rng, step = np.random.default_rng(3), 1e-3
    levels = ([0.0, 6.0, 0.0], [0.0, 4.0, 8.0, 0.0])
    recordings = []
    for name, values, coasts in (("coasting", levels[0], 1.0), ("braked", levels[1], 0.0), *third):
        v = np.repeat(values, 300)
        after = DrivenMotor(MOTOR | {"coasts": coasts}).response(v, np.zeros(len(v)), step=step)[:, :2]
        y = np.vstack([np.zeros((1, 2)), after[:-1]])  # each row with the voltage that begins then
        y += np.array([0.01, 0.3]) * rng.standard_normal(y.shape)
        columns = {"voltage [V]": v, "current [A]": y[:, 0], "speed [rad/s]": y[:, 1]}
        recordings.append(recording_from_arrays(name, np.arange(len(v)) * step, columns))
    result = estimate_parameters(recordings, workers=1, seed=1)
    assert result.verdict == "ok" and set(result.effects) == {"coasting"}
    assert [n for n in result.notes if n.startswith("coasting: the circuit is open")], result.notes
    for name, value in MOTOR.items():
        found = result.parameters[name]
        assert abs(found.value - value) < 4 * found.standard_error, name
