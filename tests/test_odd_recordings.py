"""Recordings and cases unlike the usual ones: inputs in another order, signals with gaps, a voltage below zero."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from dry_friction import DryMotor
from motors import CML050, NAMES, Motor, held_response, recording_of, step_recording

import fmu_build
from estimator.cases.case import Case, OutputSpec, ParameterSpec, RunSpec, SearchSpec
from estimator.errors import CaseError, InputError, RecordingError
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus.fmu import describe
from estimator.judging.validation import validated
from estimator.plans.planning import plan_case
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording

pytestmark = pytest.mark.usefixtures("shared_workers")

MODELS = Path(__file__).parent.parent / "models"
NOISE = (0.02, 1.0)
N, AT = 1200, 300
VOLTAGE = np.where(np.arange(N) >= AT, 10.5, 0.0)


def run(case: Case, *recordings: Recording):
    return estimate_recordings([case], [list(recordings)], workers=1)[0]


def changed(recording: Recording, **signals) -> Recording:
    """Return a recording with other or further columns, by their headers."""
    units = {"voltage": "V", "current": "A", "speed": "rad/s", "load": "N.m"}
    columns = {**recording.signals, **signals}
    return recording_from_arrays("changed", recording.time, {f"{n} [{units[n]}]": x for n, x in columns.items()})


@pytest.fixture(scope="module")
def shown():
    return held_response(CML050, VOLTAGE, step=1e-3)


@pytest.fixture
def measured(shown):
    return recording_of("bench", np.arange(N) * 1e-3, VOLTAGE, shown, noise=NOISE, seed=1)


def worst(result, motor: Motor = CML050) -> float:
    """Return the largest error in standard errors; above 4.5 by chance once in 30 000 of five."""
    return max(
        abs(result.parameters[n].value - motor.parameters[n]) / result.parameters[n].standard_error for n in NAMES
    )


# Inputs


def test_a_step_of_the_voltage_is_found_whatever_input_the_case_names_first(measured):
    recording = changed(measured, load=np.zeros(N))
    inputs = {"load": "load", "v": "voltage"}
    case = Case(inputs=inputs, outputs={"i": OutputSpec("current"), "w": OutputSpec("speed")})
    (observed,) = plan_case(case, describe("dc_motor"), recordings=[recording]).observed
    assert (observed.excitation.kind, observed.excitation.index, observed.excitation.after) == ("step", AT, 10.5)
    result = run(case, recording)
    assert result.verdict == "ok" and worst(result) < 4.5


def test_load_steps_excite_a_motor_whose_voltage_stays(case_of):
    load = np.where(np.arange(N) >= AT, 0.03, 0.0) - np.where(np.arange(N) >= 2 * AT, 0.05, 0.0)
    steady = 10.5 * np.array([CML050.B, CML050.K]) / (CML050.R * CML050.B + CML050.K**2)
    A = np.array([[-CML050.R / CML050.L, -CML050.K / CML050.L], [CML050.K / CML050.J, -CML050.B / CML050.J]])
    values, vectors = np.linalg.eig(A)
    forced = np.linalg.solve(A, np.array([0.0, -1 / CML050.J]))
    rows, x = [], np.zeros(2)  # from the steady state at 10.5 V, per held load in closed form
    for torque in load:
        rows.append(steady + x)
        x = np.real(vectors @ (np.exp(values * 1e-3) * np.linalg.solve(vectors, x + forced * torque))) - forced * torque
    recording = recording_of("loaded", np.arange(N) * 1e-3, np.full(N, 10.5), np.array(rows), noise=NOISE, seed=3)
    result = run(case_of(), changed(recording, load=load))
    assert result.verdict != "refused", result.reasons
    assert worst(result) < 4.5


def test_recordings_with_different_inputs_are_told(measured, case_of):
    loaded = changed(measured, load=np.zeros(N))
    sentence = "bench drives v, but changed drives v, load; all recordings need the same columns, or name under"
    with pytest.raises(RecordingError, match=sentence):
        run(case_of(), loaded, measured)


@pytest.mark.parametrize("delay", [3.0, -3.0, 0.95])
def test_a_delay_that_leaves_nothing_of_the_response_is_told(measured, case_of, delay):
    case = dataclasses.replace(case_of(), runs=(RunSpec(delay=delay),))
    with pytest.raises(CaseError, match=f"the delay of {delay:g} s puts the response outside bench, which is 1.199 s"):
        run(case, measured)


# Voltage below zero


@pytest.mark.full  # one way: test_effects.py
def test_a_dry_friction_is_named_whichever_way_the_motor_turns(case_of):
    """One step hardly tells it from a viscous one: it is found, or is a rival, with bars that cover it."""
    torque = 2e-3  # N·m
    rows = DryMotor({**CML050.parameters, "friction": torque, "stiction": 0.0, "brush": 0.0}).response(
        VOLTAGE[:-1], np.zeros(N - 1), step=1e-3
    )
    shown = np.vstack([np.zeros(2), rows[:, :2]])
    ahead = recording_of("dry", np.arange(N) * 1e-3, VOLTAGE, shown, noise=(0.005, 0.2), seed=1)
    back = changed(ahead, **{name: -signal for name, signal in ahead.signals.items()})
    there, mirrored = run(case_of(), ahead), run(case_of(), back)
    for result in (there, mirrored):
        assert "friction" in result.chain or "dry friction instead of" in " ".join(result.reasons), result.reasons
        assert worst(result) < 3
    assert mirrored.reasons == there.reasons and set(mirrored.chain) == set(there.chain)
    for name in NAMES:
        assert mirrored.parameters[name].value == pytest.approx(there.parameters[name].value, rel=1e-6)


# Delays, and sensors that show nothing


@pytest.mark.parametrize("method", ["integral", "steiglitz-mcbride"])
def test_a_method_without_a_search_allows_for_the_delay_that_the_data_show(case_of, method):
    recording = step_recording(CML050, duration=1.2)
    late = {name: np.concatenate([np.zeros(20), recording.signals[name][:-20]]) for name in ("current", "speed")}
    found, plain = run(case_of(method), changed(recording, **late)), run(case_of(method), recording)
    for name in NAMES:
        assert found.parameters[name].value == pytest.approx(plain.parameters[name].value, rel=1e-3)
    assert found.rmse["w"] < 1.5 * plain.rmse["w"] + 1e-6


@pytest.mark.parametrize(("column", "said"), [("current", "i is 0 A"), ("speed", "w is 0 rad/s")])
def test_a_sensor_that_shows_nothing_is_refused(measured, case_of, column, said):
    result = run(case_of(), changed(measured, **{column: np.zeros(N)}))
    assert result.verdict == "refused"
    assert f"changed: {said} from the first to the last sample while the voltage moves" in result.reasons[0]


# Gaps; warnings of numpy are errors here


def without(recording: Recording, column: str, rows) -> Recording:
    signal = recording.signals[column].copy()
    signal[rows] = np.nan
    return changed(recording, **{column: signal})


GAPS = {"every second row": slice(1, None, 2), "the end": slice(900, None), "all after the step": slice(AT + 10, None)}


@pytest.mark.parametrize("rows", GAPS.values(), ids=GAPS)
@pytest.mark.parametrize("column", ["current", "speed"])
def test_a_signal_that_is_known_in_part_tells_what_it_tells(measured, case_of, column, rows):
    result = run(case_of(), without(measured, column, rows))
    assert result.verdict != "refused" and worst(result) < 4.5


def test_a_speed_that_is_not_known_at_rest_tells_what_it_tells(measured, case_of):
    """Its mean there was asked for where no sample is: a warning of numpy's stood above the result."""
    result = run(case_of(), without(measured, "speed", slice(0, AT + 5)))
    assert result.verdict != "refused" and worst(result) < 4.5


def test_the_paper_needs_the_last_samples(measured, case_of):
    with pytest.raises(InputError, match="method 'paper' needs the current of the last samples; use method 'cuckoo'"):
        run(case_of("paper"), without(measured, "current", slice(900, None)))


def test_steiglitz_mcbride_begins_at_the_first_sample_that_is_there(case_of):
    recording = step_recording(CML050, levels=(5.0, 10.5))
    result = run(case_of("steiglitz-mcbride"), without(recording, "speed", slice(0, 1)))
    assert max(abs(result.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES) < 1e-6


# Parameters


def test_an_inductance_beside_a_fixed_resistance_is_compared_with_the_interval(case_of):
    slow = dataclasses.replace(CML050, L=1e-6)
    case = dataclasses.replace(case_of(), fixed={"R": CML050.R})
    result = run(case, step_recording(slow, noise=NOISE, duration=1.2))
    reason = result.parameters["L"].reason
    assert "sample faster to tell L" in reason and "L/R is too short" in reason and "nan" not in reason


def test_a_winding_without_inductance_is_judged_without_its_poles(tmp_path):
    text = (MODELS / "dc_motor.c").read_text()
    text = text.replace('1e-9,   1e3,   "H"', '0,      1e3,   "H"').replace("/ m->L;", "/ (m->L + 1e-3);")
    (tmp_path / "choke.c").write_text(text)
    fmu = fmu_build.build(str(tmp_path / "choke.c"), output=tmp_path / "choke.fmu")
    motor = dataclasses.replace(CML050, L=1e-3)
    case = Case(fmu=str(fmu), fixed={"L": 0.0}, recordings=(tmp_path / "made",), search=SearchSpec(seed=1))
    result = run(case, step_recording(motor, noise=NOISE, duration=1.2))
    assert result.verdict == "ok"
    for name in ("R", "K", "J", "B"):
        found = result.parameters[name]
        assert abs(found.value - CML050.parameters[name]) < 4.5 * found.standard_error


def test_a_parameter_of_each_recording_is_fitted_to_each_that_is_held_out(shown, case_of):
    def at(share: float, seed: int) -> Recording:
        time = np.arange(N) * 1e-3
        return recording_of(f"run {seed}", time, share * VOLTAGE, share * shown, noise=NOISE, seed=seed)

    parameters = {n: ParameterSpec(n, per_recording=n == "R") for n in NAMES}
    held_out = RunSpec(validate=True)
    case = dataclasses.replace(case_of(), parameters=parameters, runs=(RunSpec(), held_out, held_out))
    recordings = [at(1.0, 1), at(0.8, 2), at(0.6, 3)]
    fitted = run(dataclasses.replace(case, runs=()), recordings[0])
    found = validated(fitted, case, recordings=recordings[1:])
    assert set(found.validation.chain) == {"R run 2", "R run 3"}
    assert list(found.validation.chain.values()) == pytest.approx([CML050.R] * 2, rel=0.02)


@pytest.mark.parametrize("until", [2, 5])
def test_a_current_that_begins_behind_the_step_was_not_there_before(measured, case_of, until):
    """Its first sample was taken for all before it, at rest: R began, and was held, at a tenth, for two minutes."""
    result = run(case_of(), without(measured, "current", slice(0, AT + until)))
    assert result.verdict == "ok" and worst(result) < 4.5


# Angles


def turned(rows) -> np.ndarray:
    """Return the angle, (n,) rad, of a current and speed, (n, 2), by trapezoids."""
    w = rows[:, 1]
    return np.concatenate([[0.0], np.cumsum((w[1:] + w[:-1]) / 2)]) * 1e-3


def with_angle(recording: Recording, angle) -> Recording:
    columns = {"voltage [V]": recording.signals["voltage"], "current [A]": recording.signals["current"]}
    return recording_from_arrays("turning", recording.time, {**columns, "angle [rad]": angle})


COUNT = 2 * np.pi / 4000
SHOWN = {
    "counts": lambda angle: COUNT * np.floor(angle / COUNT),
    "a resolver": lambda angle: angle + 1e-3 * np.random.default_rng(5).standard_normal(len(angle)),
}


UP, DOWN = (5.0, 10.5), (10.5, 5.0)


@pytest.mark.parametrize(
    ("levels", "sensor"),
    [
        (UP, "counts"),
        pytest.param(UP, "a resolver", marks=pytest.mark.full),
        (DOWN, "counts"),
        (DOWN, "a resolver"),
    ],
)
def test_an_angle_of_a_motor_that_runs_already_may_begin_anywhere(case_of, levels, sensor):
    recording = step_recording(CML050, levels=levels, duration=1.2, lead=0.3, noise=(0.02, 0.0))
    angle = turned(np.column_stack([recording.signals["current"], recording.signals["speed"]])) - 12.3
    result = run(case_of(), with_angle(recording, SHOWN[sensor](angle)))
    assert result.rmse["angle"] < 2e-3 and "offset angle" in result.chain and worst(result) < 3
    assert result.verdict == "ok", result.reasons


def test_an_angle_that_does_not_begin_at_zero_is_counted_from_there(shown, measured, case_of):
    result = run(case_of(), with_angle(measured, SHOWN["a resolver"](37.0 + turned(shown))))
    assert result.verdict == "ok" and worst(result) < 4.5
    assert any("turning: angle begins at 37" in note for note in result.notes)


def test_the_held_out_angle_of_a_motor_that_runs_already_has_a_phase_of_its_own(shown, measured, case_of):
    case, resolver = case_of(), SHOWN["a resolver"]
    fitted = run(case, with_angle(measured, resolver(turned(shown))))
    running = step_recording(CML050, levels=(5.0, 10.5), duration=1.2, lead=0.3, noise=(0.02, 0.0))
    angle = turned(np.column_stack([running.signals["current"], running.signals["speed"]]))
    found = validated(fitted, case, recordings=[with_angle(running, resolver(angle))])
    assert set(found.validation.chain) == {"offset angle"}
    assert found.validation.rmse["angle"] < 0.02  # of 200 rad, by the error of the speed times 1.2 s


def test_the_angle_of_what_is_no_motor_is_taken_as_it_is(measured):
    spring = fmu_build.bundled("pmsm_dq")
    case = Case(
        fmu=str(spring),
        inputs={"vq": "voltage"},
        outputs={"angle": OutputSpec("angle")},
        parameters={"J": ParameterSpec("J", minimum=1e-6, maximum=1e-3)},
    )
    recording = with_angle(measured, np.linspace(37.0, 50.0, N))
    (observed,) = plan_case(case, describe(case.fmu), recordings=[recording]).observed
    assert observed.outputs["angle"][0] == 37.0 and not observed.notes


@pytest.mark.parametrize("low", [0.0, -np.pi], ids=["0 to 2 pi", "-pi to pi"])
def test_an_angle_that_begins_again_after_each_turn_accuses_no_speed(shown, measured, case_of, low):
    wrapped = (turned(shown) - low) % (2 * np.pi) + low
    columns = {"voltage [V]": VOLTAGE, "current [A]": measured.signals["current"]}
    for gain, verdict in ((1.0, "ok"), (1.1, "doubtful")):
        columns |= {"speed [rad/s]": gain * measured.signals["speed"], "angle [rad]": SHOWN["counts"](wrapped)}
        result = run(case_of(), recording_from_arrays("wrapped", measured.time, columns))
        assert result.verdict == verdict
    assert "the speed is shown with a gain of 1.1" in result.reasons[0]


def test_a_current_that_ends_with_the_transient_has_no_settled_mean(case_of, measured):
    """It was told as nan A."""
    ends = changed(measured, current=np.where(np.arange(N) < AT + 60, measured.signals["current"], np.nan))
    result = run(case_of(), ends)
    assert result.verdict == "ok" and worst(result) < 5
    (settled,) = [note for note in result.notes if note.startswith("settled from")]
    assert "v = 10.5 V, w = " in settled and "nan" not in settled
