"""An estimate against recordings that it has not seen."""

import dataclasses
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import test_odd_motors as odd

from estimator.cases.case import case_for_recording
from estimator.cli import main
from estimator.commands.csv_text import csv_bytes
from estimator.commands.drive import instants
from estimator.commands.paper_bench import NOMINAL
from estimator.errors import RecordingError
from estimator.estimating.estimate import estimate, estimate_recordings
from estimator.fmus.simulate import simulate
from estimator.judging.validation import validated
from estimator.recordings.reading import read_recording, recording_from_arrays

pytestmark = pytest.mark.usefixtures("shared_workers")

EXAMPLE = Path(__file__).parent.parent / "examples" / "cml050_step.csv"


@pytest.fixture(scope="module")
def made():
    case = case_for_recording(EXAMPLE)
    return case, estimate(case, workers=1, profile=True)


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """Return another recording of the same motor: two steps, other noise."""
    path = tmp_path_factory.mktemp("other") / "two_steps.csv"
    path.write_bytes(csv_bytes(two_steps(8)))
    return path


def two_steps(seed):
    times, v, shown = noise_free()
    rng = np.random.default_rng(seed)
    columns = {"time [s]": times, "voltage [V]": v}
    columns["current [A]"] = shown["i"] + 0.02 * rng.standard_normal(len(times))
    columns["speed [rad/s]"] = shown["w"] + 1.0 * rng.standard_normal(len(times))
    return columns


@cache
def noise_free():
    times = instants(stop=1.0, step=1e-3)
    v = np.where(times < 0.2, 0.0, np.where(times < 0.6, 6.0, -4.0))
    return times, v, simulate("dc_motor", parameters=NOMINAL, inputs={"v": v}, times=times)


def second(seed):
    """Return the same as a recording in memory."""
    columns = two_steps(100 + seed)
    return recording_from_arrays(f"two_steps_{seed}", columns.pop("time [s]"), columns)


def test_the_motors_own_other_recording_is_explained_to_the_noise(made, other):
    case, result = made
    found = validated(result, case, [other])
    # 1001 samples: the deviation of noise 1 is told to 2.2 %; 5 of those
    assert found.validation.rmse == pytest.approx({"i": 0.02, "w": 1.0}, rel=0.11)
    assert found.simulations - result.simulations == found.simulations_by_phase["validation"] < 100
    assert found.parameters == result.parameters and found.comparisons == result.comparisons


def test_a_wrong_parameter_shows(made, other):
    case, result = made
    parameters = dict(result.parameters)
    parameters["K"] = dataclasses.replace(parameters["K"], value=1.1 * parameters["K"].value)
    found = validated(dataclasses.replace(result, parameters=parameters), case, recordings=[read_recording(other)])
    assert found.validation.rmse["w"] > 3.0
    assert found.verdict == "doubtful" and found.validation.others.chance < 1e-12
    assert any("two_steps.csv would have other parameters, most of all K" in reason for reason in found.reasons)
    assert found.validation.others.values["K"] == pytest.approx(result.parameters["K"].value, rel=0.01)


@pytest.mark.parametrize("seed", [0, *(pytest.param(k, marks=pytest.mark.full) for k in (1, 2))])
def test_a_parameter_off_by_six_standard_errors_of_both_is_told(made, seed):
    case, result = made
    found = validated(result, case, recordings=[second(seed)])
    assert found.verdict == result.verdict == "ok" and found.validation.others.chance > 1e-3
    error = result.parameters["R"].standard_error
    parameters = dict(result.parameters)
    parameters["R"] = dataclasses.replace(parameters["R"], value=parameters["R"].value + 8.5 * error)
    told = validated(dataclasses.replace(result, parameters=parameters), case, recordings=[second(seed)])
    assert told.verdict == "doubtful" and told.validation.others.chance < 1e-3


def test_the_chance_of_recordings_of_the_motor_itself_is_uniform(made):
    from scipy.stats import kstest

    case, result = made
    chances = []
    rng = np.random.default_rng(1)
    covariance = result.correlation * np.outer(*[[result.parameters[n].standard_error for n in result.correlated]] * 2)
    for seed in range(24):  # the estimate's own errors are drawn anew, too
        drawn = rng.multivariate_normal([NOMINAL[n] for n in result.correlated], covariance)
        parameters = {
            n: dataclasses.replace(result.parameters[n], value=x) for n, x in zip(result.correlated, drawn, strict=True)
        }
        estimated = dataclasses.replace(result, parameters={**result.parameters, **parameters})
        chances.append(validated(estimated, case, recordings=[second(seed)]).validation.others.chance)
    assert min(chances) > 1e-3 and kstest(chances, "uniform").pvalue > 0.01


def test_a_recording_in_which_nothing_moves_tests_no_parameter(made):
    """It said: chi-square 0 of 0 degrees of freedom, by chance 1."""
    case, result = made
    rest, noise = np.zeros(500), 0.02 * np.random.default_rng(1).standard_normal(500)
    columns = {"voltage [V]": rest, "current [A]": noise, "speed [rad/s]": 50 * noise[::-1]}
    found = validated(result, case, recordings=[recording_from_arrays("rest", 1e-3 * np.arange(500), columns)])
    assert found.verdict == result.verdict and found.validation.others is None


def test_an_offset_of_the_estimate_is_fitted_to_a_speed_of_few_digits_too(made):
    case, found = made
    chain = dict(found.chain) | {"offset w": dataclasses.replace(found.parameters["K"], value=-40.0, unit="rad/s")}
    columns = two_steps(8)
    columns["speed [rad/s]"] = np.round(columns["speed [rad/s]"] - 40.0, 1)  # as it is printed, not counted
    other = recording_from_arrays("few_digits", columns.pop("time [s]"), columns)
    validation = validated(dataclasses.replace(found, chain=chain), case, recordings=[other]).validation
    assert validation.chain["offset w"] == pytest.approx(-40.0, abs=0.5)
    assert validation.rmse["w"] == pytest.approx(1.0, rel=0.1)


def test_the_delay_of_a_channel_is_the_estimates_and_frees_none_of_the_recordings(made, other):
    case, result = made
    late = dataclasses.replace(result.parameters["R"], name="delay w", value=0.0)
    found = validated(dataclasses.replace(result, chain={"delay w": late}), case, [other])
    assert not found.validation.chain


def test_a_turned_voltage_of_another_recording_is_told_first(made):
    columns = two_steps(9)
    columns["voltage [V]"] = -columns["voltage [V]"]
    turned = recording_from_arrays("turned", columns.pop("time [s]"), columns)
    found = validated(made[1], made[0], recordings=[turned])
    first, other = found.reasons
    assert found.verdict == "doubtful" and "check the sign of the voltage" in first and "would have other" in other
    assert first not in found.notes


def test_a_refused_estimate_is_not_validated(made, other):
    case, result = made
    refused = dataclasses.replace(result, verdict="refused", parameters={})
    assert validated(refused, case, [other]) is refused


def test_a_recording_that_is_not_there_is_told(made):
    with pytest.raises(RecordingError, match="nowhere.csv"):
        validated(made[1], made[0], [Path("nowhere.csv")])


def test_profiles_of_the_motor_are_parabolas_of_its_standard_errors(made):
    _, result = made
    assert set(result.profiles) == set(NOMINAL) and 50 < result.simulations_by_phase["profile"] < 70
    for name, profile in result.profiles.items():
        offsets = (profile.values - result.parameters[name].value) / result.parameters[name].standard_error
        np.testing.assert_allclose(profile.followed, offsets**2, rtol=0.1, atol=0.05)


def test_the_profile_changes_no_estimate(made):
    case, result = made
    plain = estimate(case, workers=1)
    assert plain.parameters == result.parameters and not plain.profiles


def test_the_command_tells_of_the_validation(other, capsys, tmp_path):
    assert main(["estimate", str(EXAMPLE), "--validate", str(other), "-o", str(tmp_path / "out")]) == 0
    assert "Validation, on recordings that were not used for the fit:\n  - i: RMSE 0.0" in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Validation: recordings that were not used for the fit" in page and "two_steps: measured" in page


def test_recordings_to_compare_with_may_be_a_pattern_and_come_once_each(other, tmp_path, capsys):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_bytes(other.read_bytes())
    assert main(["estimate", str(EXAMPLE), "--validate", f"{tmp_path}/[ab].csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["validation"]["recordings"] == ["a", "b"]
    again = [str(tmp_path / "a.csv")] * 2
    assert main(["estimate", str(EXAMPLE), "--validate", again[0], "--validate", again[1]]) == 2
    assert f"{again[0]} is given twice; leave one out" in capsys.readouterr().err


def test_a_recording_that_is_fitted_to_does_not_validate_the_fit(capsys):
    assert main(["estimate", str(EXAMPLE), "--validate", str(EXAMPLE)]) == 2
    assert "cml050_step.csv is fitted to, so it cannot validate the fit" in capsys.readouterr().err


OTHER_LEVELS = ((0.0, 0.1), (8.0, 0.4), (-5.0, 0.4), (11.0, 0.4), (2.0, 0.4))


@pytest.mark.parametrize("machine", [{"fan": 1.2e-6}, pytest.param({"weakens": 0.02}, marks=pytest.mark.full)])
def test_what_the_estimate_found_of_the_motor_is_in_its_validation(machine):
    """A fan load was left out there, and B contradicted by 16 standard errors; K that falls likewise."""
    found = odd.run(odd.bench(odd.LEVELS, **machine))
    assert found.verdict == "ok" and found.effects, found.reasons
    told = validated(found, odd.CASE, recordings=[odd.bench(OTHER_LEVELS, seed=7, **machine)])
    assert told.verdict == "ok" and told.validation.others.chance > 1e-4, told.reasons
    other = odd.bench(OTHER_LEVELS, seed=7, heavier=1.05, **machine)
    assert validated(found, odd.CASE, recordings=[other]).verdict == "doubtful"


def test_a_drive_that_opens_the_circuit_does_so_in_its_validation():
    """Its switch is chosen, not fitted: R of other commands was contradicted by 43 standard errors."""

    def coasting(levels, seed):
        v = np.repeat(levels, 250)
        times = 1e-3 * np.arange(len(v))
        shown = simulate("dc_motor_drive", parameters={**NOMINAL, "coasts": 1.0}, inputs={"v": v}, times=times)
        noise = np.random.default_rng(seed).standard_normal((2, len(v))) * [[0.02], [1.0]]
        columns = {"voltage [V]": v, "current [A]": shown["i"] + noise[0], "speed [rad/s]": shown["w"] + noise[1]}
        return recording_from_arrays("coasting", times, columns)

    (found,) = estimate_recordings([odd.CASE], [[coasting([0.0, 10.0, 4.0, 0.0, 8.0, 0.0], 0)]], workers=1)
    assert "coasting" in found.effects and found.verdict == "ok", found.reasons
    told = validated(found, odd.CASE, recordings=[coasting([0.0, 6.0, 0.0, 3.0, 9.0, 0.0], 1)])
    assert told.verdict == "ok" and told.validation.others.chance > 1e-4, told.reasons
