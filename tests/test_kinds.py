"""FMI 1.0, 2.0 and 3.0, co-simulation and model exchange: the same motor comes out of each."""

import dataclasses
import re

import fmpy
import numpy as np
import pytest
from foreign_fmus import CASE, foreign_case, foreign_fmu
from motors import CML050, NAMES, step_recording, write_recording

import fmu_build
from estimator.cases.case import SearchSpec, case_for_recording, read_case
from estimator.commands.options import with_options
from estimator.errors import FmuError, SimulationError
from estimator.estimating.estimate import estimate
from estimator.fitting.problem import Problem
from estimator.fmus.fmu import describe
from estimator.fmus.simulate import simulate
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case

pytestmark = pytest.mark.usefixtures("compiled_quickly")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    write_recording(step_recording(CML050, lead=0.01, duration=0.12), path)
    return path


def worst(e):
    return max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES)


def test_fmi_3_co_simulation_is_estimated_to_1e_8(tmp_path, recording):
    e = estimate(read_case(foreign_case(foreign_fmu(tmp_path, version=3), recording)))
    assert worst(e) < 1e-8
    assert (e.fmu["fmi_version"], e.fmu["kind"]) == ("3.0", "co-simulation")


def test_fmi_1_co_simulation_is_estimated_to_1e_8(tmp_path, recording):
    e = estimate(read_case(foreign_case(foreign_fmu(tmp_path, version=1), recording)))
    assert worst(e) < 1e-8
    assert e.fmu["fmi_version"] == "1.0"


def test_reals_of_single_precision_are_estimated_to_1e_5(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, version=3, change=[('Float64 name="(motor.Ra|u_in|shaft.w)"', r'Float32 name="\1"')])
    assert worst(estimate(read_case(foreign_case(fmu, recording)))) < 1e-5


@pytest.mark.parametrize(("setting", "moves"), [("mode = 0", True), ("mode = 1", False), ("enabled = false", True)])
def test_an_integer_and_a_boolean_of_fmi_3_are_set(tmp_path, recording, setting, moves):
    fmu = foreign_fmu(tmp_path, version=3)
    with Workers(1) as crew:
        shown = []
        for text in (CASE, CASE + f"[fixed]\n{setting}\n"):
            case = read_case(foreign_case(fmu, recording, text=text))
            problem = Problem(plan_case(case, describe(fmu)), crew, sigma={"i": 1.0, "w": 1.0})
            right = np.array([[CML050.parameters[n] for n in problem.plan.names]])
            shown.append(problem.trajectories(right).shown)
    assert (not np.array_equal(*shown)) == moves


def test_model_exchange_is_estimated_to_1e_5(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, kinds=("model-exchange",))
    e = estimate(read_case(foreign_case(fmu, recording)))
    assert worst(e) < 1e-5
    assert (e.fmu["kind"], e.fmu["fmi_version"]) == ("model-exchange", "2.0")
    assert re.match(r"one simulation of this FMU takes [\d.e-]+ s; some \d+ of them", e.notes[0])


def test_model_exchange_whose_structure_names_no_derivatives_is_refused_with_that_reason(tmp_path, recording):
    derivative = ('(name="motor.ia".*?<Real )', r'\1derivative="1" ')
    change = [("<Derivatives>.*?</Derivatives>", ""), derivative]
    fmu = foreign_fmu(tmp_path, kinds=("model-exchange",), change=change)
    with pytest.raises(FmuError, match=r"ModelStructure of foreign.fmu names no derivatives, .* \(motor.ia\)"):
        estimate(read_case(foreign_case(fmu, recording)))


def test_model_exchange_of_fmi_1_is_estimated_to_1e_5(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, version=1, kinds=("model-exchange",))
    e = estimate(read_case(foreign_case(fmu, recording)))
    assert worst(e) < 1e-5
    assert (e.fmu["kind"], e.fmu["fmi_version"]) == ("model-exchange", "1.0")


def test_what_model_exchange_of_a_bundled_model_costs_is_said(recording):
    case = dataclasses.replace(case_for_recording(recording), kind="model-exchange")
    e = estimate(dataclasses.replace(case, search=SearchSpec(method="integral")))
    assert e.fmu["kind"] == "model-exchange" and e.notes[0].startswith("one simulation of this FMU takes ")


def test_model_exchange_of_fmi_3_is_estimated_to_1e_5(tmp_path, recording):
    fmu = fmu_build.build("dc_motor", output=tmp_path / "motor.fmu", fmi=3)
    case = case_for_recording(recording, fmu=str(fmu))
    e = estimate(dataclasses.replace(case, kind="model-exchange"))
    assert worst(e) < 1e-5
    assert (e.fmu["kind"], e.fmu["fmi_version"]) == ("model-exchange", "3.0")


@pytest.mark.parametrize("version", [1, 2])
def test_model_exchange_holds_its_inputs_as_fmpy_does_with_doubled_time_stamps(tmp_path, version):
    """The reference is fmpy's own simulation: its inputs ramp, so each jump has two samples at one time."""
    fmu = foreign_fmu(tmp_path, version=version, kinds=("model-exchange",))
    h, levels = 1e-3, np.repeat([0.0, 8.0, -3.0, 5.5], 40)
    times = np.arange(len(levels) + 1) * h
    stamps = np.repeat(times, 2)[1:-1]
    doubled = np.array(list(zip(stamps, np.repeat(levels, 2), strict=True)), dtype=[("time", float), ("u_in", float)])
    expected = fmpy.simulate_fmu(
        str(fmu), fmi_type="ModelExchange", start_values={"motor.Ra": 2.0}, input=doubled, output=["shaft.w"],
        stop_time=times[-1], output_interval=h, relative_tolerance=1e-11,
    )  # fmt: skip
    taken = expected[np.unique(np.round(expected["time"] / h), return_index=True)[1]]
    held = np.append(levels, levels[-1])
    own = simulate(str(fmu), parameters={"motor.Ra": 2.0}, inputs={"u_in": held}, times=times)
    assert len(taken) == len(times)
    assert np.max(np.abs(own["shaft.w"] - taken["shaft.w"])) < 1e-7 * np.max(np.abs(taken["shaft.w"]))


def test_an_fmu_that_offers_both_is_stepped_by_itself_unless_the_user_chooses(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, kinds=("co-simulation", "model-exchange"))
    brief = CASE + '[search]\nmethod = "integral"\n'  # it is the kind that matters here
    case = read_case(foreign_case(fmu, recording, text=brief))
    chosen = read_case(
        foreign_case(fmu, recording, text=brief.replace("[inputs]", 'kind = "model-exchange"\n[inputs]'))
    )
    said = [estimate(c).fmu["kind"] for c in (case, chosen, with_options(case, kind="model-exchange"))]
    assert said == ["co-simulation", "model-exchange", "model-exchange"]


def test_an_error_of_the_equations_reaches_the_user(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, "BROKEN_EQUATIONS 0.1", kinds=("model-exchange",))
    with pytest.raises(SimulationError, match=r"every simulation of foreign.fmu failed: doStep returned Error"):
        estimate(read_case(foreign_case(fmu, recording)))
