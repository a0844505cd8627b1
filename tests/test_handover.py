"""What other tools take over: read by those tools, or by independent arithmetic."""

import csv
import dataclasses
import importlib.util
import io
import json
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.ssp.ssd import read_ssd
from made_estimates import MOTOR, UNITS, estimate, with_parameter

from estimator.cli import main
from estimator.errors import FmuError, InputError
from estimator.fmus.fmu import describe
from estimator.motor import state_space
from estimator.results import handover, handover_files, rebuild, system
from estimator.results.result import Setting
from estimator.results.result_json import to_json

FOUND = {"R": 1 / 3, "K": 0.0734721234567891, "L": 0.007759, "J": 1.36e-4, "B": 6.78e-4}  # no value is a start value
STEPS, STEP = 200, 1e-3


def found(**changes):
    """Return an estimate whose values differ from the FMU's start values."""
    made = estimate(**changes)
    for name, value in FOUND.items():
        made = with_parameter(made, name, value=value)
    return made


@pytest.fixture(scope="module")
def description():
    return describe("dc_motor")


@pytest.fixture(scope="module")
def archive(tmp_path_factory, description):
    path = tmp_path_factory.mktemp("ssp") / "motor.ssp"
    path.write_bytes(system.system_archive(found(), description))
    return path


def by_fmpy(fmu: Path, values: dict[str, float]) -> np.ndarray:
    """Return current and speed after every step at 12 V, of an FMU with values set by fmpy."""
    result = simulate_fmu(
        str(fmu), start_values={**values, "v": 12.0}, stop_time=STEPS * STEP, step_size=STEP, output_interval=STEP
    )
    return np.array([result["i"], result["w"]]).T[1:]


LIBCOSIM = """
import sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
log_output_level(CosimLogLevel.WARNING)
execution = CosimExecution.from_ssp_file(sys.argv[1])
slave = execution.slave_index_from_instance_name("motor")
references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
execution.real_initial_value(slave, references["v"], 12.0)
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
for _ in range(200):
    assert execution.step()
    print(*(x.hex() for x in observer.last_real_values(slave, [references["i"], references["w"]])))
"""
ECOS = """
import sys
from ecospy import EcosSimulation
with EcosSimulation(ssp_path=sys.argv[1], step_size=1e-3) as simulation:
    simulation.init(parameter_set="dc_motor")
    simulation.set_real("motor::v", 12.0)
    for _ in range(200):
        simulation.step()
        print(*(simulation.get_real(name).hex() for name in ("motor::i", "motor::w")))
    simulation.terminate()
"""


@pytest.mark.parametrize(("tool", "program"), [("libcosimpy", LIBCOSIM), ("ecospy", ECOS)])
def test_the_system_runs_in_other_tools_as_the_fmu_with_its_parameters_set(archive, description, tool, program):
    if importlib.util.find_spec(tool) is None:
        pytest.skip(f"{tool} is not installed")
    if subprocess.run([sys.executable, "-c", f"import {tool}"], capture_output=True).returncode:
        pytest.skip(f"{tool} cannot be loaded")
    run = subprocess.run([sys.executable, "-c", program, str(archive)], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr[-2000:]
    theirs = np.array([[float.fromhex(x) for x in line.split()] for line in run.stdout.splitlines()])
    ours = by_fmpy(description.path, FOUND)
    assert theirs.shape == ours.shape and abs(ours).max() > 10
    np.testing.assert_allclose(theirs, ours, rtol=1e-12, atol=1e-12)
    assert abs(theirs - by_fmpy(description.path, {})).max() > 1, "the start values would show"


def test_the_system_is_valid_ssp_and_holds_the_fmu_to_the_byte(archive, description):
    structure = read_ssd(str(archive), validate=True)
    (component,) = structure.system.elements
    with zipfile.ZipFile(archive) as files:
        assert files.read(component.source) == description.path.read_bytes()
        assert "resources/parameters.ssv" in files.namelist()
    assert {c.name for c in component.connectors} >= {"v", "load", "i", "w", *MOTOR}


def test_the_rebuilt_fmu_starts_with_the_estimates_and_runs_as_the_original_with_them_set(tmp_path, description):
    path = tmp_path / "again.fmu"
    path.write_bytes(rebuild.rebuilt_fmu(found(), description))
    told = {v.name: v.start for v in read_model_description(str(path)).modelVariables}
    assert {name: float(told[name]) for name in MOTOR} == FOUND
    np.testing.assert_array_equal(by_fmpy(path, {}), by_fmpy(description.path, FOUND))


def test_an_fmu_without_a_model_in_c_is_not_rebuilt_but_told(tmp_path, description):
    foreign = dataclasses.replace(description, generation_tool="another")
    with pytest.raises(FmuError, match="was not made by fmu_build .*; take the .ssp"):
        rebuild.rebuilt_fmu(found(), foreign)
    with pytest.raises(FmuError, match=r"m.fmu: Q is on 0 lines of the model's table, not on one; set its start value"):
        rebuild.with_starts("X(parameter, R, 1, 1, 0, 2)", {"Q": 1.0}, title="m.fmu")


def test_the_matlab_script_keeps_every_bit_and_its_lines_are_ascii_statements():
    text = handover.matlab_script(found()).decode("ascii")
    values = {m[1]: float(m[2]) for m in re.finditer(r"^parameters\.(\w+) = (.+?);", text, re.M)}
    errors = {m[1]: float(m[2]) for m in re.finditer(r"^standard_errors\.(\w+) = (.+?);", text, re.M)}
    assert values == FOUND and errors == {n: p.standard_error for n, p in found().parameters.items()}
    assert "set_param(block, 'R', '0.3333333333333333', 'K'," in text


def test_octave_runs_the_script(tmp_path):
    octave = shutil.which("octave") or shutil.which("octave-cli")
    if octave is None:
        pytest.skip("octave is not installed")
    (tmp_path / "p.m").write_bytes(handover.matlab_script(found()))
    done = subprocess.run(
        [octave, "--eval", "p; printf('%.17g ', parameters.R, A(1,2))"], cwd=tmp_path, capture_output=True, text=True
    )
    assert [float(x) for x in done.stdout.split()] == [1 / 3, -FOUND["K"] / FOUND["L"]]


def test_the_matlab_script_of_what_is_no_motor_has_no_matrices():
    made = found()
    made = dataclasses.replace(made, parameters={"drive.R": dataclasses.replace(made.parameters["R"], name="drive.R")})
    text = handover.matlab_script(made).decode()
    assert "parameters.drive_R = " in text and "A = " not in text and "'drive.R', '" in text


def test_a_quote_in_a_variables_name_is_doubled_in_matlab():
    made = with_parameter(found(), "R", settings=(Setting("'winding 1'.R", 1.25, "Ohm"),))
    assert "set_param(block, '''winding 1''.R', '1.25'," in handover.matlab_script(made).decode()


def test_the_modelica_modifier_goes_down_into_components():
    made = with_parameter(
        found(), "K", settings=(Setting("drive.motor.Ke", 0.5, ""), Setting("drive.n", 3.0, "", "Integer"))
    )
    made = with_parameter(made, "R", settings=(Setting("drive.motor.R", 1.25, "Ohm"),))
    line = handover.modelica_modifier(made).decode().splitlines()[2]
    assert line == "(drive(motor(R=1.25, Ke=0.5), n=3), L=0.007759, J=0.000136, B=0.000678)"


def test_the_modelica_modifier_leaves_out_what_modelica_cannot_name():
    made = with_parameter(found(), "K", settings=(Setting("motor[1].K", 0.5, ""), Setting("'K.1'.value", 0.5, "")))
    lines = handover.modelica_modifier(made).decode().splitlines()
    assert lines[2].startswith("(R=") and "'K.1'(value=0.5)" in lines[2] and "motor" not in lines[2]
    assert lines[3] == "// Not set, as no modifier can: motor[1].K = 0.5"


def test_the_table_reads_back_to_the_bit():
    rows = list(csv.DictReader(io.StringIO(handover.csv_table(found()).decode())))
    assert {row["parameter"]: float(row["value"]) for row in rows} == FOUND
    assert {row["parameter"]: row["unit"] for row in rows} == UNITS


def test_the_state_space_moves_as_the_fmu_does(description):
    from scipy.signal import cont2discrete

    transition, push, *_ = cont2discrete(state_space.matrices(FOUND), STEP)
    state, rows = np.zeros(2), []
    for _ in range(STEPS):
        state = transition @ state + push @ [12.0, 0.0]
        rows.append(state)
    np.testing.assert_allclose(rows, by_fmpy(description.path, FOUND), rtol=1e-9, atol=1e-9)


def test_the_transfer_functions_are_those_of_the_matrices():
    from scipy.signal import ss2tf

    made = json.loads(handover.state_space_json(found()))
    s = 2j * np.pi * 30
    for k, u in enumerate(made["inputs"]):
        numerators, denominator = ss2tf(*(np.array(made[m]) for m in "ABCD"), input=k)
        for y, numerator in zip(made["outputs"], numerators, strict=True):
            function = made["transfer_functions"][f"{y}/{u}"]
            ours = np.polyval(function["numerator"], s) / np.polyval(function["denominator"], s)
            assert ours == pytest.approx(np.polyval(numerator, s) / np.polyval(denominator, s), rel=1e-9)


def test_scipy_takes_the_motor():
    np.testing.assert_array_equal(state_space.state_space(FOUND).A, state_space.matrices(FOUND)[0])


def test_what_is_no_motor_has_no_linear_model():
    with pytest.raises(InputError, match="a linear motor model needs R, K, L, J and B"):
        state_space.matrices({"R": 1.0})
    with pytest.raises(InputError, match="with L and J positive"):
        state_space.matrices({**FOUND, "L": 0.0})


# --- the command ---------------------------------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path, description):
    made = found(fmu={"name": "dc_motor", "path": str(description.path), "communication_step": 1e-3})
    made = with_parameter(made, "L", standard_error=None, upper=float("inf"), at_bound="lower")
    (tmp_path / "result.json").write_text(to_json(made))
    return tmp_path


def test_a_stored_result_comes_back_as_it_was():
    made = with_parameter(found(), "L", standard_error=None, upper=float("inf"), settings=())
    back = handover.estimate_from_json(to_json(made))
    assert back.verdict == made.verdict and back.fmu == made.fmu
    for name, parameter in made.parameters.items():
        set_in_fmu = parameter.set_in_fmu
        assert dataclasses.replace(back.parameters[name], settings=None) == dataclasses.replace(
            parameter, settings=None
        )
        assert back.parameters[name].set_in_fmu == set_in_fmu


def test_export_writes_all_formats_beside_the_result(folder, capsys):
    assert main(["export", str(folder)]) == 0
    out, err = capsys.readouterr()
    names = (
        "dc_motor.fmu, dc_motor.ssp, modifier.mo, motor_parameters.m, parameters.csv, parameters.ssv, state_space.json"
    )
    assert (out, err) == (f"Written to {folder}: {names}\n", "")
    assert {p.name for p in folder.iterdir()} == {"result.json", *names.split(", ")}


def test_export_writes_the_formats_that_are_asked_for(folder, tmp_path, capsys):
    output = tmp_path / "there"
    assert main(["export", str(folder / "result.json"), "--format", "csv", "--format", "ssp", "-o", str(output)]) == 0
    assert {p.name for p in output.iterdir()} == {"parameters.csv", "dc_motor.ssp"}


def test_what_an_estimate_does_not_allow_is_left_out_with_its_reason(folder, capsys):
    text = (folder / "result.json").read_text().replace('"K":', '"Kt":', 1).replace('"path": "', '"path": "/nowhere')
    (folder / "result.json").write_text(text)
    assert main(["export", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "Left out, ssp: the FMU is no longer at /nowhere" in out and "say with --fmu where it is" in out
    assert "Left out, fmu: " in out and "Left out, state-space: a linear motor model needs R, K, L, J and B" in out
    assert main(["export", str(folder), "--format", "ssp", "--fmu", "dc_motor"]) == 0


def test_an_fmu_without_the_variables_that_were_estimated_is_not_taken(folder, capsys):
    text = (folder / "result.json").read_text()
    (folder / "result.json").write_text(re.sub(r'"variables": \{\s*"R"', '"variables": {"motor.Ra"', text))
    assert main(["export", str(folder), "--fmu", "dc_motor", "--format", "ssp"]) == 2
    assert "dc_motor.fmu has no parameter 'motor.Ra' (R, K, L, J, B)" in capsys.readouterr().err


def test_where_the_fmu_says_no_units_it_is_told_what_a_motors_parts_are_taken_for(folder, capsys):
    bare = found()
    for name in ("L", "J"):
        bare = with_parameter(bare, name, unit="")
    (folder / "result.json").write_text(to_json(bare))
    assert main(["export", str(folder), "--format", "modelica", "--format", "matlab", "--format", "state-space"]) == 0
    told = "the FMU says no unit of L, J: matrices and parts of a motor are right if these are in SI"
    assert told in capsys.readouterr().err
    assert all(told in (folder / n).read_text() for n in ("modifier.mo", "motor_parameters.m", "state_space.json"))


def test_a_doubtful_result_is_exported_with_a_warning(folder, capsys):
    path = folder / "result.json"
    path.write_text(path.read_text().replace('"verdict": "ok"', '"verdict": "doubtful"'))
    assert main(["export", str(folder), "--format", "csv"]) == 0
    assert capsys.readouterr().err.startswith("fmu-estimator: the estimate is doubtful")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (None, "No such file or directory; give the folder or the result.json of estimate -o"),
        (b"\xff\xfe", "is no text; give the folder or the result.json of estimate -o"),
        (b"{}", "is no result of an estimate: it lacks 'verdict'; give the result.json that estimate -o wrote"),
        (b"[]", "is no result of an estimate: its content is another; give"),
        (b"time,v\n", "is no result of an estimate: it is no JSON; give"),
        (b"[" * 100_000, "is no result of an estimate: it is no JSON; give"),
        (
            to_json(estimate()).replace('"ok"', '"fine"', 1).encode(),
            "is no result of an estimate: no such verdict: 'fine'; give",
        ),
        (to_json(estimate()).replace('"recordings": [', '"recordings": [5', 1).encode(), "is no result of an"),
        (to_json(estimate(verdict="refused", reasons=("no step",))).encode(), "nothing to export: no step"),
        (to_json(with_parameter(estimate(), "R", value=float("nan"))).encode(), "R has no value"),
    ],
)
def test_what_cannot_be_exported_is_told_in_one_sentence(tmp_path, capsys, content, sentence):
    if content is not None:
        (tmp_path / "result.json").write_bytes(content)
    assert main(["export", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and sentence in err


def test_the_command_line_offers_the_formats_there_are():
    from estimator.app import outcomes
    from estimator.commands.result_arguments import FORMATS

    assert FORMATS == handover_files.FORMATS
    assert outcomes.FORMATS is handover_files.FORMATS


def test_names_that_matlab_cannot_tell_apart_get_fields_of_their_own():
    one = found().parameters["R"]
    names = ("a.R", "a_R", "a R")
    made = dataclasses.replace(found(), parameters={n: dataclasses.replace(one, name=n) for n in names})
    text = handover.matlab_script(made).decode()
    for table in ("parameters", "standard_errors"):
        assert re.findall(rf"^{table}\.(\w+) =", text, re.MULTILINE) == ["a_R_1", "a_R", "a_R_2"]
