"""What cannot be estimated is refused with its evidence; what can be is not."""

import dataclasses
import re

import numpy as np
import pytest
from driven_motor import DrivenMotor
from motors import CML050, RMCS2004, Motor, held_response, recording_of, step_recording
from scipy.signal import lfilter

from estimator.cases.case import OutputSpec, ParameterSpec, RunSpec
from estimator.estimating.estimate import estimate_recordings
from estimator.explaining.adequacy import Failure
from estimator.explaining.effects import EFFECTS
from estimator.fmus.fmu import describe
from estimator.judging.lost_signs import lost_signs
from estimator.judging.misfit import unexplained
from estimator.judging.refusal import refused_notes
from estimator.plans.planning import plan_case
from estimator.results.reason import Place, Reason

pytestmark = pytest.mark.usefixtures("shared_workers")


def run(case, recording):
    return estimate_recordings([case], [[recording]], workers=1)[0]


def made(voltage, shown, *, noise=(0.02, 1.0), seed=1):
    return recording_of("made", np.arange(len(voltage)) * 1e-3, voltage, shown, noise=noise, seed=seed)


@pytest.fixture(scope="module")
def good():
    voltage = np.where(np.arange(1500) >= 300, 10.5, 0.0)
    return voltage, held_response(CML050, voltage, step=1e-3)


def refused(case_of, recording, *words):
    result = run(case_of(), recording)
    assert result.verdict == "refused"
    assert result.parameters == {}
    assert all(word in " ".join(result.reasons) for word in words), result.reasons
    return result


@pytest.mark.smoke
def test_no_voltage_logged(case_of, good):
    refused(case_of, made(0 * good[0], good[1]), "no voltage was logged")


def test_a_part_that_would_fit_other_values_is_told_so_that_a_small_excess_does_not_read_as_none():
    alone = Failure("values", "the recording", "i", 1.02).sentence
    assert alone.startswith("i alone would fit other parameters") and "1.02 times" in alone
    part = Failure("values", "the settled part", "i", 3.2).sentence
    assert part.startswith("i in the settled part would fit") and "3.2 times" in part


def test_no_excitation(case_of, good):
    refused(case_of, made(0 * good[0], 0 * good[1]), "nothing is excited")


def test_recordings_that_are_not_refused_by_themselves_are_named(case_of, good):
    """One of a speed whose sign is wrong refused them all, and nobody said that the others may be estimated."""
    wrong = dataclasses.replace(made(good[0], good[1] * [1, -1]), name="turned")
    (result,) = estimate_recordings([case_of()], [[made(*good), wrong]], workers=1)
    assert result.verdict == "refused" and "turned" in result.reasons[0]
    assert any(note.startswith("not refused by itself: made") for note in result.notes), result.notes


def test_a_reason_of_the_whole_set_spares_no_recording(case_of, good):
    """A sentence of the whole set names no recording; beside one with a place the others were told as good."""
    wrong = dataclasses.replace(made(good[0], good[1] * [1, -1]), name="turned")
    case = case_of()
    plan = plan_case(case, describe(case.fmu), recordings=[made(*good), wrong])
    placed, of_all = Reason("its sign is wrong", Place("turned", "w", 0.0, 1.0)), Reason("no voltage was logged")
    spared = [[n for n in refused_notes(plan, r) if n.startswith("not refused")] for r in ([placed], [placed, of_all])]
    assert spared == [["not refused by itself: made; leave the others out to estimate from what is left"], []]


@pytest.mark.parametrize(("level", "moves"), [(0.0, True), (0.0, False), (2.0, False)])
def test_no_excitation_of_what_is_driven_by_no_voltage_names_its_input(case_of, good, level, moves):
    recording = made(0 * good[0], moves * good[1])
    recording = dataclasses.replace(recording, signals={**recording.signals, "voltage": np.full(1500, level)})
    inputs, outputs = {"load": "voltage"}, {"i": OutputSpec("current"), "w": OutputSpec("speed")}
    case = dataclasses.replace(case_of(), inputs=inputs, outputs=outputs)
    recording = dataclasses.replace(recording, units={**recording.units, "voltage": "N.m"})
    recording = dataclasses.replace(recording, headers={**recording.headers, "voltage": "voltage [N.m]"})
    result = run(case, recording)
    told = (
        "is zero throughout while i and w move: it was not logged" if moves else "so nothing is excited; record a step"
    )
    assert result.verdict == "refused"
    assert result.reasons[0].startswith("the input 'load' ") and told in result.reasons[0]


def test_a_speed_of_the_wrong_sign_knows_where_it_goes_against_the_voltage(case_of, good):
    result = refused(case_of, made(good[0], good[1] * [1, -1]), "the speed goes against the voltage")
    ((place,),) = [reason.places for reason in result.reasons]
    assert place.signal == "w" and 0.3 < place.start < 0.32 and place.end == pytest.approx(1.499)


def test_a_sign_that_a_factor_turned_is_not_to_be_turned_by_it(case_of, good):
    turned = dataclasses.replace(case_of(), runs=(RunSpec(scale={"i": -1.0}),))
    result = run(turned, made(*good))
    assert result.verdict == "refused"
    assert result.reasons[0].endswith("(or of the voltage); leave out the factor that turns i")


def test_a_current_that_is_saturated_nearly_everywhere(case_of, good):
    shown = good[1].copy()
    noisy = shown + np.random.default_rng(2).standard_normal(shown.shape) * [0.02, 1.0]
    noisy[:, 0] = np.minimum(noisy[:, 0], 0.55)
    refused(case_of, made(good[0], noisy, noise=(0, 0)), "saturated at 0.55")


def test_a_spike_of_a_decaying_current_in_a_measured_voltage_is_no_reversal(case_of):
    """One row below zero, where the freewheeling current was, asks for no negative current."""
    voltage = np.repeat([0.0, 10.5], [100, 700])
    shown = held_response(CML050, voltage, step=1e-3)
    logged = voltage.copy()
    logged[400] = -10.5
    assert run(case_of(), made(logged, shown)).verdict != "refused"


def test_a_current_without_its_sign_where_the_voltage_reverses(case_of):
    voltage = np.repeat([0.0, 10.0, -10.0, 5.0, -5.0], 200)
    shown = held_response(CML050, voltage, step=1e-3)
    refused(case_of, made(voltage, np.abs(shown) * [1, 0] + shown * [0, 1], noise=(0, 1)), "its sign was lost")


@pytest.mark.parametrize("lost", ["speed", "voltage"])
def test_a_speed_or_a_voltage_without_its_sign_where_the_motor_turns_back(case_of, lost):
    """A counter that tells no direction: thirteen reasons that had nothing to do with it, after half a minute."""
    voltage = np.repeat([0.0, 10.0, -8.0, 5.0], 200)
    shown = held_response(CML050, voltage, step=1e-3)
    if lost == "speed":
        refused(case_of, made(voltage, np.abs(shown) * [0, 1] + shown * [1, 0]), "but the speed is never negative")
    else:
        refused(case_of, made(np.abs(voltage), shown), "but the voltage is never negative")
    short = np.repeat([0.0, 10.0, -8.0, 10.0], [200, 200, 8, 200])  # too short to turn the motor back
    assert run(case_of(), made(short, held_response(CML050, short, step=1e-3))).verdict == "ok"


def test_a_speed_below_zero_beside_no_voltage_is_an_offset_and_no_lost_sign(case_of, good):
    """A recording at rest, beside others, tells the offset of each sensor; that of a speed may be negative."""
    rest = made(np.zeros(800), np.tile([0.0, -5.0], (800, 1)), noise=(0.02, 1))
    case = case_of()
    plan = plan_case(case, describe(case.fmu), recordings=[rest, made(*good, noise=(0.02, 1))])
    assert [lost_signs(o) for o in plan.observed] == [[], []]


@pytest.mark.parametrize("rows", [175, 205])
def test_a_current_that_swings_below_zero_when_its_recording_ends_has_its_sign(rows, case_of):
    """A large motor's does, beyond the peak of its speed: it was told to check the sign of its current."""
    large = Motor("large", 180.0, 2.9, 0.98, 0.083, 0.0112, 0.0057)
    voltage = np.where(np.arange(rows) >= 30, 180.0, 0.0)
    shown = held_response(large, voltage, step=1e-3)
    assert shown[-1, 0] < -0.5
    found = run(case_of(), made(voltage, shown, noise=(0.05, 0.3)))
    assert found.verdict != "refused", found.reasons
    assert all(abs(p.value - large.parameters[n]) < 4.5 * p.standard_error for n, p in found.parameters.items())


def test_a_current_that_droops_behind_a_clamp_of_alternating_current_has_its_sign(case_of, good):
    """Its inrush shows the sign; it was told to check it, as the current ends below zero."""
    light, a = dataclasses.replace(CML050, B=1e-5), np.exp(-1e-3 / 0.15)  # of a high-pass of 0.15 s
    voltage = good[0][:500]
    shown = held_response(light, voltage, step=1e-3)
    shown[:, 0] = lfilter([a, -a], [1.0, -a], shown[:, 0])
    assert shown[-1, 0] < -0.02 * shown[:, 0].max()
    found = run(case_of(), made(voltage, shown, noise=(0.01, 1)))
    assert found.verdict != "refused" and "AC coupling" in found.effects, found.reasons
    assert all(abs(p.value - light.parameters[n]) < 4.5 * p.standard_error for n, p in found.parameters.items())


def test_a_random_command_of_single_rows_is_no_noise_around_its_mean(case_of):
    """Its levels are few, and far apart: it was told to stay where its mean is while the motor does not start."""
    bits = np.random.default_rng(4).integers(0, 2, 400)
    voltage = np.concatenate([np.zeros(20), np.where(bits, 6.8, 3.7)])
    found = run(case_of(), made(voltage, held_response(CML050, voltage, step=1e-3)))
    assert found.verdict != "refused", found.reasons
    assert all(abs(p.value - CML050.parameters[n]) < 4.5 * p.standard_error for n, p in found.parameters.items())


def test_a_heavy_rotor_that_a_short_reversal_only_slows_down_has_its_sign(case_of):
    """It turned on in its old direction, hardly slower, and was taken to run steadily in the other."""
    heavy = dataclasses.replace(CML050, J=2e-3)
    voltage = np.repeat([0.0, 10.0, 4.0, 8.0, -5.0], [100, 250, 250, 250, 250])
    shown = held_response(heavy, voltage, step=1e-3)
    assert np.min(shown[:, 1]) >= 0
    assert run(case_of(), made(voltage, shown, noise=(0.02, 1))).verdict != "refused"


def test_a_coarse_encoder_that_turns_back_has_its_sign(case_of, monkeypatch):
    """Its counts, 63 rad/s each, were taken for the noise of a speed that is never negative."""
    monkeypatch.setenv("FMU_ESTIMATOR_WITHOUT", ",".join(effect.name for effect in EFFECTS))  # which take long
    voltage = np.repeat([0.0, 10.0, 4.0, 8.0, -5.0], [100, 250, 250, 250, 250])
    shown = held_response(CML050, voltage, step=1e-3)
    count = 2 * np.pi / 100
    shown[:, 1] = np.diff(np.floor(np.cumsum(shown[:, 1]) * 1e-3 / count + 0.3), prepend=0.0) * count / 1e-3
    assert run(case_of(), made(voltage, shown, noise=(0.02, 0))).verdict != "refused"


@pytest.mark.parametrize("late", [0, 3])
def test_a_current_without_its_sign_where_the_motor_brakes(case_of, late):
    """What braked it was shown as what drives it: R and K were told by the bounds of the case."""
    voltage = np.repeat([0.0, 10.0, 0.0], [100, 400, 300])
    shown = held_response(CML050, voltage, step=1e-3)
    shown[:, 0] = np.roll(shown[:, 0], late)
    lost = np.abs(shown) * [1, 0] + shown * [0, 1]
    refused(case_of, made(voltage, lost, noise=(0.01, 1)), "flows back: its sign was lost")


def test_a_current_that_does_not_flow_back_through_a_diode_has_its_sign(case_of):
    voltage = np.repeat([0.0, 10.0, 0.0], [100, 400, 300])
    after = DrivenMotor(CML050.parameters | {"coasts": 1.0}).response(voltage, np.zeros(len(voltage)), step=1e-3)[:, :2]
    shown = np.vstack([np.zeros((1, 2)), after[:-1]])
    shown[500:, 0] = 0.0
    assert run(case_of(), made(voltage, shown, noise=(0.01, 1))).verdict != "refused"


def test_a_rectified_current_at_rest(case_of, good):
    noisy = good[1] + np.random.default_rng(3).standard_normal(good[1].shape) * [0.02, 1.0]
    noisy[:, 0] = np.abs(noisy[:, 0])
    refused(case_of, made(good[0], noisy, noise=(0, 0)), "never negative in 300 samples")


def test_an_offset_of_few_digits_is_no_rectified_current(case_of, good):
    """Of 0.2 A beside a noise of 0.1 A, printed by tenths: in whole steps the median's distances are as of folded."""
    noise = np.random.default_rng(3).standard_normal(good[1].shape) * [0.09, 1.0]
    noise[:300, 0] = np.abs(noise[:300, 0] + 0.2)  # none of them is below zero
    shown = good[1] + noise
    shown[:, 0] = np.round(shown[:, 0], 1)
    plan = plan_case(case_of(), describe(case_of().fmu), recordings=[made(good[0], shown, noise=(0, 0))])
    rest = shown[:300, 0]
    assert rest.min() >= 0 and np.median(rest) < 2.5 * np.median(np.abs(rest - np.median(rest)))
    assert [lost_signs(o) for o in plan.observed] == [[]]


@pytest.mark.parametrize(("column", "what"), [(0, "current"), (1, "speed")])
def test_a_sign_that_contradicts_the_voltage(case_of, good, column, what):
    shown = good[1].copy()
    shown[:, column] *= -1
    refused(case_of, made(good[0], shown), f"check the sign of the {what}")


def test_a_lost_transient_still_gives_what_the_steady_state_gives(case_of, good):
    keep = np.r_[0:301, 400:1500]
    result = refused(case_of, made(good[0][keep], good[1][keep]), "the transient is lost")
    note = next(n for n in result.notes if "the settled part still determines" in n)
    assert "an oscillation above half the sampling rate of 1000 Hz may be what is lost (aliasing)" in result.reasons[0]
    assert "record at 10000 Hz or more" in result.reasons[0]
    ratio = float(note.split("B/K = ")[1].split()[0])
    assert ratio == pytest.approx(CML050.B / CML050.K, rel=0.02)


def test_good_recordings_are_not_refused(case_of):
    for seed in range(4):
        for motor in (CML050, RMCS2004):
            result = run(case_of(), step_recording(motor, noise=(0.02, 1.0), seed=seed, duration=1.5))
            assert result.verdict == "ok", result.reasons


def test_an_impossible_acceleration(case_of, good):
    keep = np.r_[0:303, 309:1500]  # six samples of the steepest part are missing
    lost = made(good[0][keep], good[1][keep])
    result = refused(case_of, lost, "an impossible acceleration", "the transient is lost")
    assert "aliasing" not in result.reasons[0]  # what remains of the response is slow
    told = re.compile(r"lost rows at t = 0.30\d s: some [56].* rows seem to be missing")
    assert any(told.match(note) for note in result.notes)


def test_a_fast_motor_is_doubtful_and_not_refused(case_of):
    fast = Motor("fast", 10.5, R=2.0, K=0.05, L=1e-3, J=5e-7, B=2e-5)
    result = run(case_of(), step_recording(fast, noise=(0.02, 1.0), seed=2))
    assert result.verdict in ("ok", "doubtful")
    for name in ("R", "K", "J", "B"):
        p = result.parameters[name]
        assert abs(p.value - fast.parameters[name]) < 5 * p.standard_error


def test_a_slow_recording_that_is_estimated_does_not_say_that_its_transient_is_lost(case_of, good):
    slow = recording_of("slow", 0.02 * np.arange(75), good[0][::20], good[1][::20], noise=(0.02, 1.0), seed=1)
    result = run(case_of(), slow)
    assert result.verdict == "doubtful" and abs(result.parameters["R"].value / CML050.R - 1) < 0.5
    told = " ".join(result.reasons)
    assert "lie within one sample" in told and "the recording is slow for this motor" in told
    assert "lost" not in told.replace("may be what is lost (aliasing)", "")


def test_a_recording_that_holds_no_sample_of_its_transient_is_refused_before_the_search(case_of, good):
    slow = recording_of("slow", 0.05 * np.arange(30), good[0][::50], good[1][::50], noise=(0.02, 1.0), seed=1)
    result = run(case_of(), slow)
    assert (result.verdict, result.simulations) == ("refused", 0) and "the transient is lost" in result.reasons[0]
    known = dataclasses.replace(case_of(), fixed={"J": CML050.J})
    assert run(known, slow).simulations > 0  # what J would need is not asked of the data


def test_a_response_that_has_not_settled_is_doubtful(case_of):
    result = run(case_of(), step_recording(RMCS2004, noise=(0.02, 1.0), seed=1, duration=0.56))
    assert result.verdict == "doubtful"
    assert any("has not settled" in reason for reason in result.reasons)


@pytest.mark.full  # eight seconds; others are doubted for what is not explained in test_effects.py
def test_a_model_that_does_not_explain_the_data_is_doubtful(case_of, good):
    shown = good[1].copy()
    shown[:, 1] *= 1 - 0.1 * np.clip(shown[:, 1] / shown[:, 1].max(), 0, 1) ** 3  # no linear motor
    result = run(case_of(), made(good[0][:700], shown[:700], noise=(0.01, 0.5)))
    assert result.verdict == "doubtful"
    assert result.parameters


def test_the_windows_in_which_an_output_is_not_explained_are_one_sentence():
    size = [Failure("size", window, "w", excess) for window, excess in (("the start", 7.24), ("the rest", 3.1))]
    alone, other = Failure("size", "the start", "i", 2.0), Failure("neighbours", "the rest", "w", 0.3)
    assert unexplained([size[0], alone, size[1], other]) == [
        "the model does not explain w: the residuals, whitened, are 7.2 times the noise found in the start, 3.1 times"
        " in the rest",
        alone.sentence,
        other.sentence,
    ]


def test_a_bound_that_is_wrong_is_blamed_and_not_the_bench(case_of):
    """The truth, 0.01307 H, is out of reach; whatever else would explain the residuals is not looked for."""
    case = dataclasses.replace(case_of("cuckoo"), parameters={"L": ParameterSpec("L", minimum=1e-4, maximum=0.01)})
    (estimate,) = estimate_recordings([case], [[step_recording(CML050, duration=1.0)]])
    assert estimate.verdict == "doubtful" and not estimate.chain
    assert any(r.startswith("L: the estimate lies at its upper bound 0.01; widen the bound") for r in estimate.reasons)
    assert not any("sag" in reason or "gain" in reason or "drift" in reason for reason in estimate.reasons)
    assert {estimate.parameters[name].status for name in "RKJB"} <= {"doubtful", "not identified"}


def test_a_reason_knows_where_in_the_data_it_lies(case_of, good):
    keep = np.r_[0:301, 400:1500]
    result = refused(case_of, made(good[0][keep], good[1][keep]), "the transient is lost")
    ((place,),) = [reason.places for reason in result.reasons]
    assert place.signal == "w" and place.end - place.start == pytest.approx(1e-3) and 0.29 < place.start < 0.31
    (shown,) = result.comparisons
    assert shown.name == place.recording and not shown.simulated and set(shown.measured) == {"i", "w"}
    clipped = good[1] + np.random.default_rng(2).standard_normal(good[1].shape) * [0.02, 1.0]
    clipped[:, 0] = np.minimum(clipped[:, 0], 0.55)
    ((place, *_), *_) = [r.places for r in refused(case_of, made(good[0], clipped, noise=(0, 0)), "saturated").reasons]
    assert place.signal == "i" and place.end > place.start


@pytest.mark.parametrize("sign", [1, -1])
def test_a_motor_that_brakes_from_either_direction_keeps_its_sign(case_of, sign):
    """Backwards, at hardly any load, the current that braked it was the first one above zero: it was refused."""
    motor = dataclasses.replace(CML050, B=CML050.B / 20)
    voltage = sign * np.repeat([10.0, 0.0], [400, 300])
    shown = held_response(motor, np.concatenate([voltage[:1].repeat(2000), voltage]), step=1e-3)[2000:]
    assert run(case_of(), made(voltage, shown, noise=(0.01, 1))).verdict != "refused"


def test_a_sample_that_is_missing_as_the_motor_brakes_is_no_current(case_of):
    voltage = np.repeat([0.0, 10.0, 0.0], [100, 400, 300])
    shown = held_response(CML050, voltage, step=1e-3)
    shown[:, 0] = np.abs(shown[:, 0])
    shown[505, 0] = np.nan
    result = refused(case_of, made(voltage, shown, noise=(0.01, 1)), "flows back: its sign was lost")
    assert not any("nan" in reason for reason in result.reasons)


def test_a_speed_that_a_logger_holds_for_eight_rows_may_rise_by_all_of_them_at_once(case_of):
    """Of a fast motor that was "an impossible acceleration"."""
    voltage = np.repeat([0.0, 10.5], [100, 500])
    shown = held_response(CML050, voltage, step=1e-4 / 2)
    noisy = shown + np.random.default_rng(4).standard_normal(shown.shape) * [0.01, 0.5]
    noisy[:, 1] = np.repeat(noisy[::8, 1], 8)[: len(noisy)]
    recording = recording_of("held", np.arange(600) * 1e-4 / 2, voltage, noisy, noise=(0, 0), seed=1)
    assert run(case_of(), recording).verdict != "refused"


def test_a_current_whose_mean_was_taken_off_is_no_current_of_another_sign(case_of):
    """At the end it is below zero, but at rest further below."""
    voltage = np.repeat([0.0, 10.5], [20, 120])
    shown = held_response(CML050, voltage, step=1e-3)
    shown = shown - np.array([np.mean(shown[:, 0]), 0.0])
    assert shown[-1, 0] < -0.05
    assert run(case_of(), made(voltage, shown)).verdict != "refused"
