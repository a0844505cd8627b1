"""The other methods by name: right where they apply, honest where they do not."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, RMCS2004, held_response, recording_of, step_recording

from estimator.cases.case import ParameterSpec
from estimator.errors import InputError
from estimator.estimating.estimate import estimate_recordings
from estimator.fitting.steiglitz_mcbride import steiglitz_mcbride
from estimator.motor.integral_least_squares import integral_estimate
from estimator.motor.transfer_functions import NoMotorError
from estimator.recordings.reading import recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")


def errors(estimate, motor):
    return {name: abs(p.value / motor.parameters[name] - 1) for name, p in estimate.parameters.items()}


def run(case, recording):
    return estimate_recordings([case], [[recording]], workers=1)[0]


@pytest.mark.parametrize("motor", [CML050, RMCS2004])
def test_steiglitz_mcbride_is_exact_without_noise(case_of, motor):
    result = run(case_of("steiglitz-mcbride"), step_recording(motor))
    assert result.verdict == "ok"
    assert max(errors(result, motor).values()) < 1e-8
    assert result.simulations == 3


def test_integral_least_squares_is_within_a_percent_without_noise(case_of):
    result = run(case_of("integral"), step_recording(CML050))
    assert max(errors(result, CML050).values()) < 0.01


@pytest.mark.parametrize("missing", [slice(0, 505), slice(520, None)])
def test_integral_least_squares_takes_nothing_from_rows_that_no_current_reaches(missing):
    r = step_recording(CML050, duration=1.0)
    v, i, w = (r.signals[n].copy() for n in ("voltage", "current", "speed"))
    i[missing] = np.nan
    found = integral_estimate(v, i, w, step=1e-3)
    assert max(abs(found[name] / getattr(CML050, name) - 1) for name in ("R", "K", "L", "J")) < 0.03


def test_integral_least_squares_errs_by_the_square_of_the_sampling_interval():
    found = []
    for interval in (1e-3, 0.5e-3):
        r = step_recording(CML050, interval=interval, duration=1.0)
        v, i, w = (r.signals[n] for n in ("voltage", "current", "speed"))
        found.append(abs(integral_estimate(v, i, w, step=interval)["L"] / CML050.L - 1))
    assert found[0] / found[1] == pytest.approx(4, rel=0.1)


def test_differential_evolution_reaches_the_truth_through_the_fmu(case_of):
    result = run(case_of("differential-evolution"), step_recording(CML050))
    assert max(errors(result, CML050).values()) < 1e-6
    assert result.simulations > 1000


@pytest.mark.parametrize("method", ["integral", "steiglitz-mcbride"])
def test_a_direct_method_refuses_a_case_with_a_fixed_parameter(case_of, method):
    case = dataclasses.replace(case_of(method), fixed={"L": 0.013})
    with pytest.raises(InputError, match="finds R, K, L, J and B together, but here is L fixed"):
        run(case, step_recording(CML050))


@pytest.mark.parametrize("method", ["integral", "steiglitz-mcbride"])
def test_a_direct_method_takes_one_recording(case_of, method):
    one = step_recording(CML050)
    with pytest.raises(InputError, match="takes one recording"):
        estimate_recordings([case_of(method)], [[one, one]], workers=1)


def test_a_direct_method_needs_current_and_speed(case_of):
    r = step_recording(CML050)
    case = dataclasses.replace(case_of("integral"), inputs={"v": "voltage"}, parameters={"R": ParameterSpec("R")})
    only = recording_from_arrays(
        "w", r.time, {"voltage [V]": r.signals["voltage"], "speed [rad/s]": r.signals["speed"]}
    )
    from estimator.cases.case import OutputSpec

    case = dataclasses.replace(case, outputs={"w": OutputSpec("speed")})
    with pytest.raises(InputError, match="needs voltage, current and speed, but 'i' is missing"):
        run(case, only)


def test_steiglitz_mcbride_does_not_apply_under_load(case_of):
    case = dataclasses.replace(case_of("steiglitz-mcbride"), fixed={"load": 0.01})
    with pytest.raises(InputError, match="does not apply under load"):
        run(case, step_recording(CML050))


def test_steiglitz_mcbride_says_when_no_motor_fits():
    rng = np.random.default_rng(1)
    v = np.where(np.arange(400) > 50, 10.0, 0.0)
    with pytest.raises(NoMotorError, match="no motor has|no continuous motor|no stable"):
        steiglitz_mcbride(v, rng.standard_normal(400), rng.standard_normal(400), step=1e-3, sigma=(1, 1))


def test_steiglitz_mcbride_takes_any_input():
    v = np.repeat(np.random.default_rng(3).uniform(-10, 10, 60), 20)
    y = held_response(CML050, v, step=1e-3)
    found = steiglitz_mcbride(v, y[:, 0], y[:, 1], step=1e-3, sigma=(0.02, 1.0))
    assert found == pytest.approx(CML050.parameters, rel=1e-8)


def test_what_no_motor_has_is_refused_with_its_numbers(case_of):
    v = np.where(np.arange(600) >= 50, 10.0, 0.0)
    y = held_response(CML050, v, step=1e-3)
    backwards = recording_of("backwards", np.arange(600) * 1e-3, v, y * [1.0, -1.0])
    result = run(case_of("integral"), backwards)
    assert result.verdict == "refused"
    assert "check the sign of the speed" in result.reasons[0]
