"""The names of a case are resolved once, against its FMU and its recordings."""

import dataclasses

import pytest
from foreign_fmus import foreign_case, foreign_fmu
from motors import CML050, step_recording, write_recording

from estimator.cases.case import Case, read_case
from estimator.commands.options import with_options
from estimator.errors import InputError
from estimator.fmus.fmu import describe
from estimator.plans.binding import bind
from estimator.plans.planning import plan_case
from estimator.recordings.reading import read_recording


@pytest.fixture(scope="module")
def binding(tmp_path_factory):
    folder = tmp_path_factory.mktemp("binding")
    write_recording(step_recording(CML050, lead=0.02, duration=0.1), folder / "step.csv")
    change = [
        (
            "</ModelVariables>",
            '<ScalarVariable name="torque" valueReference="20" causality="input" description="">'
            '<Real unit="N.m" start="0"/></ScalarVariable></ModelVariables>',
        )
    ]
    case = read_case(foreign_case(foreign_fmu(folder, change=change), folder / "step.csv"))
    case = dataclasses.replace(case, fixed={"torque": 0.25})
    return bind(case, describe(case.fmu), [read_recording(folder / "step.csv")])


def test_a_signal_is_known_by_the_cases_name_and_a_target_by_the_fmus(binding):
    assert binding.signal("v") is binding.own["u_in"] and binding.signal("i") is binding.own["motor.ia"]
    assert [spec.fmu for spec in binding.free if spec.name == "K"] == [("motor.Ke", "motor.Km")]
    assert binding.channels[0].inputs == {"v": "voltage"} and binding.channels[0].outputs["w"] == "speed"


def test_an_input_that_no_column_drives_is_there_and_one_that_is_fixed_is_held(binding):
    assert list(binding.inputs) == ["v", "torque"]
    assert binding.held_inputs == {"torque": 0.25}


def test_an_output_that_is_compared_under_another_name_is_not_asked_for(binding):
    assert binding.unshown == ("centispeed",)


def test_the_same_names_hold_in_another_fmu():
    case = Case(fmu="dc_motor")
    recording = step_recording(CML050, lead=0.02, duration=0.1)
    other = bind(case, describe("dc_motor"), [recording]).on(describe("dc_motor_friction"))
    assert "friction" in other.own and "friction" not in [spec.name for spec in other.free]
    assert other.signal("w").value_reference == describe("dc_motor_friction").variable("w").value_reference


def test_bounds_for_one_parameter_leave_free_what_would_be_free_without():
    case = with_options(Case(fmu="dc_motor_friction"), bounds=[("R", (0.1, 10.0))])
    assert list(case.parameters) == ["R", "K", "L", "J", "B", "friction"]


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        (
            '[expect]\nRr = { value = 3.1, within = "1 %" }',
            r"\[expect\]: the estimate will have no parameter 'Rr'; did",
        ),
        (
            '[expect]\nstandard_error = { Q = "1 %" }',
            r"\[expect\]: the estimate will have no parameter 'Q' \(R, K, J, B, L",
        ),
        ("[expect]\nrmse = { u = 0.1 }", r"\[expect\]: the estimate will have no output 'u' \(i, w\)"),
        (
            "[parameters]\nR = { start = -3 }",
            "parameter 'R' starts at -3, outside the range 1e-06 to 1e\\+06 that dc_mo",
        ),
        (
            '[outputs]\nw = { column = "speed", gain = 1e-140 }',
            r"output 'w': by a gain of 1e-140 and an offset of 0 the speed in step.csv went up to .*, as no mot",
        ),
        (
            '[outputs]\nw = { column = "speed", offset = 1e9 }',
            r"output 'w': by a gain of 1 and an offset of 1e\+09 the speed in step.csv went up to 1e\+09 rad/s, as no",
        ),
        ("[fixed]\nB = true", r"\[fixed\] B is a number in dc_motor.fmu; give one, not true"),
    ],
)
def test_what_the_fmu_cannot_mean_is_told_before_anything_is_simulated(said, complaint, tmp_path):
    write_recording(step_recording(CML050, lead=0.02, duration=0.1), tmp_path / "step.csv")
    case = tmp_path / "a.case.toml"
    said += '\n[inputs]\nv = "voltage"' if "[outputs]" in said else ""
    fixed = "" if "[fixed]" in said else "[fixed]\nL = 0.013\n"
    case.write_text(f'{fixed}{said}\n[[recording]]\nfile = "step.csv"\n')
    with pytest.raises(InputError, match=complaint):
        plan_case(read_case(case), describe("dc_motor"))
