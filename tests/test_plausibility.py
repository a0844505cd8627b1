"""What of a recording is named as implausible, and that good recordings are not."""

import numpy as np
import pytest
from motors import CML050, Motor, all_motors, held_response
from scipy.signal import lfilter

from estimator.cli import main
from estimator.recordings.lag import lag_misfit
from estimator.recordings.measured_signals import MeasuredSignals
from estimator.recordings.plausibility import implausible

SI = frozenset()
NOBODY = frozenset({"v", "i", "w", "time"})


def signals(motor, *, interval, samples=1500, seed=0, reverse=False):
    """Return times and noisy v, i, w of a step to a motor's voltage, and back through zero where it is reversed."""
    v = np.zeros(samples)
    v[samples // 6 :] = motor.voltage
    if reverse:
        v[samples // 2 :] *= -1
    shown = exact(motor, v, interval)
    noise = np.random.default_rng(seed).standard_normal(shown.shape) * 0.005 * np.abs(shown).max(axis=0)
    i, w = (shown + noise).T
    return interval * np.arange(samples), {"v": v, "i": i, "w": w}


def exact(motor, v, interval):
    from scipy.linalg import expm

    a = np.array([[-motor.R / motor.L, -motor.K / motor.L], [motor.K / motor.J, -motor.B / motor.J]])
    block = np.zeros((3, 3))
    block[:2, :2], block[0, 2] = a, 1 / motor.L
    step = expm(block * interval)
    x, rows = np.zeros(2), np.zeros((len(v), 2))
    for k, u in enumerate(v):
        rows[k] = x
        x = step[:2, :2] @ x + step[:2, 2] * u
    return rows


def time_constant(motor):
    return motor.R * motor.J / (motor.K**2 + motor.R * motor.B)


BENCH = [m for m in all_motors() if m.voltage <= 48]


def found(time, signals, guessed=SI, sure=frozenset(), **said):
    return implausible(MeasuredSignals("run.csv", time, signals, guessed=guessed, **said), sure=sure)


def test_samples_too_near_for_any_motor_are_refused_whoever_says_their_unit():
    """Of 1e-11 s and less the noise's fit ended in a LinAlgError."""
    time, measured = signals(CML050, interval=1e-3)
    (doubted,) = found(1e-5 * time, measured)  # of 10 ns: a unit that may be said again
    assert (doubted.kind, doubted.is_fatal) == ("unit time", True)
    assert found(1e-5 * time, measured, sure=frozenset({"time"})) == ()
    (finding,) = found(1e-9 * time, measured, sure=frozenset({"time"}))
    assert (
        finding.is_fatal
        and finding.is_sure
        and "its samples are 1e-12 s apart (1e+12 Hz), too near for any motor" in finding.sentence
    )


@pytest.mark.parametrize(
    ("signal", "factor", "told"),
    [
        ("v", 1e-6, "the voltage goes up to 1.05e-05 V"),
        ("v", 1e5, "the voltage goes up to 1.05e+06 V"),
        ("i", 1e-6, "the current goes up to 2.3"),
        ("i", 1e9, "the current goes up to 2.3"),
        ("w", 1e-9, "the speed goes up to 1."),
        ("w", 1e6, "the speed goes up to 1."),
    ],
)
def test_a_size_that_no_motor_has_is_refused_whoever_says_its_unit(signal, factor, told):
    """Their fits ended in a LinAlgError, or after half a minute."""
    time, measured = signals(CML050, interval=1e-3)
    measured[signal] = factor * measured[signal]
    first = found(time, measured, sure=frozenset({"v", "i", "w", "time"}))[0]
    assert first.kind == f"unit {signal}" and first.is_fatal
    assert told in first.sentence and f"--scale {signal}=FACTOR" in first.sentence


@pytest.mark.parametrize("guessed", [SI, NOBODY], ids=["units said", "units not said"])
@pytest.mark.parametrize("reverse", [False, True])
def test_good_recordings_of_real_motors_are_plausible(guessed, reverse):
    for seed, motor in enumerate(BENCH):
        time, good = signals(motor, interval=time_constant(motor) / 20, seed=seed, reverse=reverse)
        assert found(time, good, guessed) == (), motor.name


def test_the_emulated_bench_is_plausible():
    v = np.where(np.arange(600) < 100, 0.0, 10.5)
    i, w = held_response(CML050, v, step=1e-3).T
    assert found(1e-3 * np.arange(600), {"v": v, "i": i, "w": w}) == ()


@pytest.mark.parametrize("motor", BENCH, ids=lambda m: m.name)
def test_current_and_speed_exchanged_are_named_and_nothing_else(motor):
    time, good = signals(motor, interval=time_constant(motor) / 20)
    (finding,) = found(
        time, {**good, "i": good["w"], "w": good["i"]}, columns={"i": "current [A]", "w": "speed [rad/s]"}
    )
    assert finding.kind == "exchanged" and finding.is_fatal
    edge = time[np.flatnonzero(good["v"])[0] - 1]
    assert [e.signal for e in finding.evidence] == ["i", "w"]
    assert all(e.start == edge and edge < e.end < 0.75 * time[-1] for e in finding.evidence), "the response, no more"
    assert "--column 'i=speed [rad/s]' --unit i=A --column 'w=current [A]' --unit w=rad/s" in finding.sentence


@pytest.mark.parametrize("seed", range(5))
def test_a_voltage_that_changes_its_sign_and_acts_late_is_of_the_right_sign(seed):
    """The motor, of a time constant of 5 ms, is driven 26 ms late: at most times its speed is against the voltage."""
    rng = np.random.default_rng(seed)
    v = 6.0 * np.where(np.cumsum(rng.random(2400) < 1 / 45) % 2, 1.0, -1.0)
    late = np.concatenate([np.zeros(26), v[:-26]])
    w = lfilter([1 - np.exp(-1 / 5)], [1, -np.exp(-1 / 5)], 20 * late) + 0.3 * rng.standard_normal(2400)
    i = 0.1 * np.diff(w, prepend=0.0) + 0.01 * rng.standard_normal(2400)
    time = 1e-3 * np.arange(2400)
    assert not [f for f in found(time, {"v": v, "i": i, "w": w}) if f.kind.startswith("sign")]
    assert [f for f in found(time, {"v": v, "i": i, "w": -np.roll(w, -26)}) if f.kind == "sign w"]


@pytest.mark.parametrize(("turned", "option"), [("i", "--scale i=-1"), ("w", "--scale w=-1"), ("iw", "--scale v=-1")])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_sign_is_named_with_the_option_that_turns_it(turned, option, reverse):
    time, good = signals(CML050, interval=1e-3, reverse=reverse)
    (finding,) = found(time, {n: -y if n in turned else y for n, y in good.items()})
    assert option in finding.sentence and finding.is_fatal
    assert {e.signal for e in finding.evidence} == set(turned)
    assert all(e.start >= 0.25 - 1e-3 for e in finding.evidence), "before the step nothing goes against anything"


@pytest.mark.parametrize("seed", range(4))
def test_one_sample_of_a_fast_oscillation_is_no_sign(seed):
    """The current's first swing ends between two samples; what follows is positive, and lower than its noise."""
    motor = Motor("light", 10.5, R=4.96, K=0.281, L=3.33e-3, J=6.63e-7, B=7.56e-5)
    time, good = signals(motor, interval=1e-3)
    shown = exact(motor, good["v"], 1e-3) + np.random.default_rng(seed).standard_normal((1500, 2)) * [0.02, 1.0]
    assert shown[250:, 0].mean() > 0 > shown[250:254, 0].mean()
    assert not [f for f in found(time, {**good, "i": shown[:, 0], "w": shown[:, 1]}) if f.kind.startswith("sign")]


@pytest.mark.parametrize(
    ("signal", "factor", "option"),
    [
        ("i", 1e3, "--unit i=mA"),
        ("i", 1e-4, "--unit i=A"),
        ("w", 30 / np.pi, "--unit w=rpm"),
        ("w", 180 / np.pi, "--unit w=deg/s"),
        ("v", 1 / 12, "--scale v=VOLTS"),
        ("v", 255 / 12, "--scale v=VOLTS/255"),
        ("time", 1e3, "--unit time=ms"),
        ("time", 1e6, "--unit time=us"),
    ],
)
def test_a_unit_that_nobody_said_is_doubted_where_no_motor_is_like_that(signal, factor, option):
    time, good = signals(CML050, interval=1e-3)
    good["time"] = time
    good[signal] = factor * good[signal]
    findings = found(good.pop("time"), good, NOBODY)
    assert [f.kind for f in findings] == [f"unit {signal}"] and option in findings[0].sentence
    assert findings[0].is_fatal == (factor == 1e6), "of steps of 1 000 s no simulation comes to its end"
    assert {e.signal for e in findings[0].evidence} == ({"i", "w"} if signal == "time" else {signal})
    assert all(e.end > e.start >= 0.8 * np.argmax(good["v"] > 0) * 1e-3 for e in findings[0].evidence)


def test_milliamperes_under_a_header_in_amperes_are_doubted_and_a_large_motor_is_not():
    time, good = signals(CML050, interval=1e-3)
    ((finding,), none) = (found(time, {**good, "i": factor * good["i"]}) for factor in (1e3, 100.0))
    assert finding.kind == "unit i" and "--unit i=mA" in finding.sentence and none == ()


@pytest.mark.parametrize(
    ("signal", "unit", "factor", "told"),
    [
        ("i", "mA", 1e-3, "a winding of 4.5 kΩ: it looks like A that were read as mA; say so with --unit i=A"),
        ("v", "mV", 1e-3, "it looks like V that were read as mV; say so with --unit v=V"),
        ("v", "V", 1e3, "up to 1.05e+04 V: it looks like mV; say so with --unit v=mV"),
    ],
)
def test_a_thousandfold_under_a_header_that_says_its_unit_is_doubted_alone(signal, unit, factor, told):
    time, good = signals(CML050, interval=1e-3)
    wrong = {**good, signal: factor * good[signal]}
    units = {"v": "V", "i": "A", "w": "rad/s", "time": "s"} | {signal: unit}
    (finding,) = found(time, wrong, units=units)
    assert finding.kind == f"unit {signal}" and told in finding.sentence and not finding.is_fatal
    assert found(time, good, units=units) == () == found(time, wrong, units=units, sure=frozenset({signal}))


def test_whole_milliamperes_under_a_header_in_amperes_are_doubted_and_amperes_are_not():
    """A coreless motor of 21 ohm takes 0.29 A from 6 V: 290 "A" are no more than large motors take, but whole."""
    time, good = signals(next(m for m in BENCH if m.name == "6V coreless micro"), interval=2e-4)
    whole = np.round(1e3 * good["i"])
    (finding,) = found(time, {**good, "i": whole})
    assert finding.kind == "unit i" and "it looks like mA" in finding.sentence
    assert found(time, {**good, "i": whole + 0.004 * good["w"]}) == () == found(time, good)


@pytest.mark.parametrize("coarse", [1, 20], ids=["the rise of the current shows", "it does not"])
def test_real_motors_whose_current_is_in_milliamperes_are_plausible(coarse):
    for seed, motor in enumerate(BENCH):
        time, good = signals(motor, interval=coarse * time_constant(motor) / 20, seed=seed)
        assert found(time, good, units={"v": "mV", "i": "mA"}) == (), motor.name


def test_a_current_of_nothing_in_milliamperes_is_no_winding():
    time, good = signals(CML050, interval=1e-3)
    nothing = {**good, "i": np.zeros_like(good["i"])}
    assert "unit i" not in {f.kind for f in found(time, nothing, units={"v": "V", "i": "mA"})}


def test_what_the_user_said_again_is_doubted_no_more():
    time, good = signals(CML050, interval=1e-3)
    wrong = {**good, "w": 57.3 * good["w"]}
    assert [f.kind for f in found(time, wrong)] == ["unit w"]
    assert found(time, wrong, sure=frozenset({"w"})) == ()


@pytest.mark.parametrize(("factor", "unit"), [(30 / np.pi, "rpm"), (180 / np.pi, "deg/s"), (1 / 2 / np.pi, "rev/s")])
def test_the_angle_beside_it_tells_the_unit_of_the_speed(factor, unit):
    time, good = signals(CML050, interval=1e-3)
    angle = np.concatenate([[0.0], np.cumsum((good["w"][1:] + good["w"][:-1]) / 2 * np.diff(time))])
    (finding,) = found(time, {**good, "w": factor * good["w"], "angle": angle})
    assert f"held against the angle, the speed is {unit}, not rad/s; say so with --unit w={unit}" in finding.sentence
    assert found(time, {**good, "angle": angle}) == ()


def test_an_encoders_steps_tell_the_unit_of_a_speed_without_one():
    time, good = signals(CML050, interval=1e-3)
    lines = 60 / (1e-3 * 192)  # rpm of one count of 192 a turn
    rpm = np.round(good["w"] * 30 / np.pi / lines) * lines
    (finding,) = found(time, {**good, "w": rpm}, frozenset({"w"}))
    assert "192 counts a turn in rpm" in finding.sentence
    counts = np.round(good["w"] * 1e-3 * 192 / (2 * np.pi)) * (2 * np.pi / 192 / 1e-3)
    assert found(time, {**good, "w": counts}, frozenset({"w"})) == ()


def test_a_full_duty_cycle_that_was_called_volts_is_doubted_and_a_motor_at_one_volt_is_not():
    motor = next(m for m in BENCH if m.voltage >= 12)
    time, y = signals(motor, interval=time_constant(motor) / 20)
    full = y["w"] * 300.0 / np.max(y["w"])
    one = {**y, "v": y["v"] / np.max(y["v"]), "w": full}
    (named,) = found(time, one)
    assert named.kind == "unit v" and "duty cycle" in named.sentence
    assert found(time, {**one, "w": 0.5 * full}) == ()
    assert found(time, {**one, "v": 0.9 * one["v"]}) == ()


@pytest.mark.parametrize("full", [100.0, 255.0, 1000.0, 1023.0, 4095.0])
def test_a_scale_that_ends_exactly_where_a_duty_cycle_does_is_doubted_though_it_was_called_volts(full):
    time, y = signals(CML050, interval=1e-3)
    (named,) = found(time, {**y, "v": y["v"] * full / np.max(y["v"])})
    assert named.kind == "unit v" and f"--scale v=VOLTS/{full:g}" in named.sentence
    assert found(time, {**y, "v": y["v"] * 0.97 * full / np.max(y["v"])}) == () or full > 100.0
    assert found(time, {**y, "v": y["v"] * full / np.max(y["v"])}, sure=frozenset({"v"})) == ()


def test_a_coarse_sensor_of_amperes_shows_no_milliamperes_where_they_are_not_whole():
    """A motor of 16 mOhm takes 3 kA, in steps of 3.7 A: it was doubted as if they were milliamperes."""
    time, y = signals(CML050, interval=1e-3)
    large = {**y, "v": y["v"] * 27 / np.max(y["v"]), "i": np.round(y["i"] * 800 / 3.7393) * 3.7393}
    assert found(time, large) == ()
    assert [f.kind for f in found(time, {**large, "i": np.round(large["i"])})] == ["unit i"]


def test_several_levels_up_to_exactly_one_volt_are_doubted_sooner_than_a_step_of_one_volt():
    time, y = signals(CML050, interval=1e-3)
    fast = {**y, "w": y["w"] * 150.0 / np.max(y["w"]), "v": y["v"] / np.max(y["v"])}
    assert found(time, fast) == (), "a step of a volt"
    v = fast["v"] * np.repeat([0.25, 0.5, 0.75, 1.0, 0.5], len(time) // 5)[: len(time)]
    (named,) = [f for f in found(time, {**fast, "v": v}) if f.kind == "unit v"]
    assert "it looks like a duty cycle, in parts of the supply (0 to 1); give" in named.sentence
    assert not [f for f in found(time, {**fast, "v": v, "w": 0.5 * fast["w"]}) if f.kind == "unit v"]


def test_a_few_samples_that_are_far_above_all_others_are_named_as_the_loggers_errors():
    time, y = signals(CML050, interval=1e-3)
    lone = y["i"].copy()
    lone[700] = 1e5
    (named,) = [f for f in found(time, {**y, "i": lone}) if f.kind == "lone i"]
    assert named.is_fatal
    assert "the current is 1e+05 at t = 0.7 s, more than 300 times as large as all others" in named.sentence
    lone[800:802] = -2e5
    (named,) = [f for f in found(time, {**y, "i": lone}) if f.kind == "lone i"]
    assert "one of 3 samples that are more than 300 times" in named.sentence
    lone[700:706] = 1e5  # longer than an error: something else
    assert not [f for f in found(time, {**y, "i": lone}) if f.kind == "lone i"]


def test_a_misfit_that_is_enough_is_not_made_smaller_and_one_that_is_not_is_as_small_as_can_be():
    time, own = signals(BENCH[0], interval=time_constant(BENCH[0]) / 20)
    for drive, y in (("i", "w"), ("w", "i")):
        least = lag_misfit(time, own[drive], own[y])
        assert least <= lag_misfit(time, own[drive], own[y], enough=2 * least) <= 2 * least
        assert lag_misfit(time, own[drive], own[y], enough=0.5 * least) == least


WAITS = 60  # rows


def switched_on_late(volts=24.0, *, noise=0.0, samples=1000):
    """Return times and signals of a motor that gets a step, beside a supply's voltage in every row."""
    time, measured = signals(CML050, interval=1e-3, samples=samples)
    first = samples // 6 - WAITS
    supply = volts * (1 + noise * np.random.default_rng(1).standard_normal(samples))
    return time[first:], {**{name: y[first:] for name, y in measured.items()}, "v": supply[first:]}


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("seen", ["i", "w", "iw"])
def test_a_voltage_that_is_there_before_the_motor_has_a_current_is_the_supplys(seen, noise):
    """24 V of a supply that gave 10.5 V were told as a delay of 0.1 s: R, K twice too large, ok."""
    time, measured = switched_on_late(noise=noise)
    measured = {name: y for name, y in measured.items() if name in {"v", *seen}}
    (finding,) = found(time, measured)
    assert finding.kind == "unit v" and "this is the supply before a switch" in finding.sentence
    (turned,) = found(time, {name: -y for name, y in measured.items()})
    assert ": -2" in turned.sentence and turned.kind == finding.kind
    assert found(time, measured, sure=frozenset({"v"})) == ()


def test_a_wait_that_is_short_in_a_long_recording_is_long_beside_the_motors_rise():
    (finding,) = found(*switched_on_late(samples=6000))
    assert finding.kind == "unit v"


def test_a_motor_that_answers_at_once_or_runs_or_is_switched_off_has_its_own_voltage():
    time, measured = switched_on_late()
    late = {name: y[WAITS - 10 :] for name, y in measured.items()}
    assert found(time[WAITS - 10 :], late) == ()
    running = {name: y[400:] for name, y in measured.items()}
    assert found(time[400:], running) == ()
    off = measured["v"].copy()
    off[-50:] = 0.0
    assert found(time, measured | {"v": off}) == ()


def test_a_constant_voltage_that_was_said_is_not_doubted(tmp_path, capsys):
    time, measured = switched_on_late()
    table = np.column_stack([time, measured["i"], measured["w"]])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="time,current,speed", comments="")
    assert main(["check", str(tmp_path / "run.csv"), "--fix", "v=10.5"]) == 0
    assert "Implausible" not in capsys.readouterr().out
