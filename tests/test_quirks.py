"""What FMUs in the wild do, each quirk once, by name: it ends in a right estimate or in one clear sentence.

docs/any-fmu.md is the table of quirks against these tests; a test here keeps it complete.
"""

import ast
import contextlib
import dataclasses
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import psutil
import pytest
from faulty import faulty_fmu
from foreign_fmus import CASE, foreign_case, foreign_fmu
from motors import CML050, NAMES, step_recording, write_recording
from test_containment import IF_BAD, MARK

import fmu_build
from estimator.cases.case import case_for_recording, read_case
from estimator.cli import main
from estimator.errors import FmuError, SimulationError
from estimator.estimating.estimate import estimate, estimate_by
from estimator.fitting.problem import Problem
from estimator.fmus.fmu import describe
from estimator.fmus.workers import Workers
from estimator.plans.planning import plan_case

TABLE = Path(__file__).resolve().parent.parent / "docs" / "any-fmu.md"
NOISE = (2e-3, 0.2)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "step.csv"
    write_recording(step_recording(CML050, lead=0.05, duration=0.25), path)
    return path


def estimated(fmu, recording, *, text=CASE):
    return estimate(read_case(foreign_case(fmu, recording, text=text)), workers=1)


def worst(e):
    return max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES)


def bundled_copy(folder, change):
    """Return a copy of the bundled FMU with its description changed."""
    target = folder / "copy.fmu"
    with zipfile.ZipFile(fmu_build.bundled("dc_motor")) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            data = old.read(name)
            if name == "modelDescription.xml":
                text = data.decode()
                for before, after in change:
                    assert before in text
                    text = text.replace(before, after)
                data = text.encode()
            new.writestr(name, data)
    return target


# Beginning again


@pytest.mark.parametrize(
    ("define", "restart"),
    [  # each is also found by test_probe.py::test_what_is_found_decides_how_the_fmu_is_driven
        ("IDLE_RESET", "re-instantiate"),
        pytest.param("FAILING_RESET", "re-instantiate", marks=pytest.mark.full),
        pytest.param("CRASHING_RESET", "re-instantiate", marks=pytest.mark.full),
    ],
)
def test_a_reset_that_does_nothing_fails_or_crashes(tmp_path, recording, define, restart):
    e = estimated(foreign_fmu(tmp_path, define), recording)
    assert worst(e) < 1e-8
    assert e.fmu["restart"] == restart


def test_a_missing_reset(tmp_path, recording):
    e = estimated(foreign_fmu(tmp_path, "NO_RESET"), recording)
    assert worst(e) < 1e-8 and e.fmu["restart"] == "re-instantiate"


def test_a_missing_function_that_is_needed_is_told(tmp_path, recording):
    with pytest.raises(FmuError) as caught:
        estimated(foreign_fmu(tmp_path, "NO_INSTANTIATE"), recording)
    sentence = "foreign.fmu cannot be used: it does not run: its library has no function fmi2Instantiate"
    assert str(caught.value) == sentence


def test_missing_functions_that_are_never_called(tmp_path, recording):
    assert worst(estimated(foreign_fmu(tmp_path, "NO_EXTRAS"), recording)) < 1e-8


def test_a_reset_that_leaks_is_recycled_above_the_memory_limit(tmp_path, recording):
    leak = "volatile char *lost = malloc(4 << 20); for (int k = 0; k < 4 << 20; k += 4096) lost[k] = 1;"
    fmu = faulty_fmu(tmp_path, Reset=leak)
    limit, seen, peak = 300 << 20, set(), []

    def look():
        for pid in crew.pool.pids:
            with contextlib.suppress(psutil.NoSuchProcess):
                peak.append(psutil.Process(pid).memory_info().rss)
                seen.add(pid)

    with Workers(1, memory_limit=limit) as crew:
        e = estimate_by(crew, case_for_recording(recording, fmu=str(fmu)), progress=lambda _: look())
    assert worst(e) < 1e-8 and e.fmu["restart"] == "reset" and e.failed_simulations == 0
    assert e.simulations > 150 and len(seen) > 1  # 600 MiB are lost in all
    assert max(peak) < limit + (300 << 20)


def test_instances_that_share_their_parameters(tmp_path, recording):
    e = estimated(foreign_fmu(tmp_path, "SHARED"), recording)
    assert worst(e) < 1e-8 and e.fmu["restart"] == "reset"


@pytest.mark.full
def test_once_per_process_without_reset(tmp_path, recording):
    change = [("canHandleVariable", 'canBeInstantiatedOnlyOncePerProcess="true" canHandleVariable')]
    e = estimated(foreign_fmu(tmp_path, "ONCE", "IDLE_RESET", change=change), recording)
    assert worst(e) < 1e-8 and e.fmu["restart"] == "fresh process"


def test_once_per_process_with_reset(tmp_path, recording):
    change = [("canHandleVariable", 'canBeInstantiatedOnlyOncePerProcess="true" canHandleVariable')]
    e = estimated(foreign_fmu(tmp_path, "ONCE", change=change), recording)
    assert worst(e) < 1e-8 and e.fmu["restart"] == "reset"


def test_needs_an_execution_tool_but_runs_all_the_same(tmp_path, recording, capsys):
    fmu = foreign_fmu(tmp_path, change=[("canHandleVariable", 'needsExecutionTool="true" canHandleVariable')])
    assert worst(estimated(fmu, recording)) < 1e-8
    assert main(["inspect", str(fmu), "--static"]) == 0
    assert "it needs its tool, A foreign tool" in capsys.readouterr().out


def test_needs_an_execution_tool_that_is_not_there(tmp_path, recording):
    change = [("canHandleVariable", 'needsExecutionTool="true" canHandleVariable')]
    fmu = foreign_fmu(tmp_path, "NO_TOOL", change=change)
    with pytest.raises(FmuError) as caught:
        estimated(fmu, recording)
    assert str(caught.value) == (
        "foreign.fmu cannot be used: it does not run: instantiate gave no instance; it needs its tool, A foreign tool,"
        " to be installed and running"
    )


# Parameters and variables


@pytest.mark.parametrize("variability", ["fixed", pytest.param("tunable", marks=pytest.mark.full)])
def test_all_parameters_fixed_or_tunable(tmp_path, recording, variability):
    fmu = foreign_fmu(tmp_path, change=[('variability="fixed"', f'variability="{variability}"')])
    assert worst(estimated(fmu, recording)) < 1e-8


def test_parameters_set_after_initialisation_are_ignored(tmp_path, recording):
    assert worst(estimated(foreign_fmu(tmp_path, "LATE_IGNORED"), recording)) < 1e-8


def test_no_parameter_named_k_but_two_constants(tmp_path, recording):
    e = estimated(foreign_fmu(tmp_path), recording)
    assert e.parameters["K"].value == pytest.approx(CML050.K, rel=1e-8)


def test_current_only_as_a_local_variable(tmp_path, recording):
    fmu = foreign_fmu(tmp_path)
    assert describe(fmu).variable("motor.ia").causality == "local"
    assert worst(estimated(fmu, recording)) < 1e-8


def test_no_input_at_all(tmp_path):
    path = tmp_path / "step.csv"
    write_recording(step_recording(CML050, lead=0.1, duration=0.4), path)
    text = re.sub(r"\[inputs\]\nv = .*\n", "", CASE)
    assert worst(estimated(foreign_fmu(tmp_path, "SELF_DRIVEN"), path, text=text)) < 1e-8


def test_an_integer_output_is_compared(tmp_path):
    measured = step_recording(CML050, lead=0.05, duration=0.2)
    counts = np.trunc(measured.signals["speed"] * 100)
    table = np.column_stack([measured.time, measured.signals["voltage"], counts])
    path = tmp_path / "counts.csv"
    np.savetxt(path, table, delimiter=",", header="time [s],voltage [V],counts", comments="", fmt="%.17g")
    text = CASE.replace('i = {{ column = "current", fmu = "motor.ia" }}\n', "")
    text = text.replace(
        'w = {{ column = "speed", fmu = "shaft.w" }}', 'n = {{ column = "counts", fmu = "centispeed" }}'
    )
    case = read_case(foreign_case(foreign_fmu(tmp_path), path, text=text))
    with Workers(1) as crew:
        problem = Problem(plan_case(case, describe(case.fmu)), crew, sigma={"n": 1.0})
        right = [CML050.parameters[n] for n in problem.plan.names]
        costs = problem.costs(np.array([right, [1.1 * x for x in right]]))
    assert costs[0] <= 10 < 1e4 < costs[1]  # a count here and there, at a rounding's edge


# Steps and times


def test_no_parameter_is_ok_by_a_step_that_moves_it_by_more_than_its_error(tmp_path):
    """By noise that hides the misfit R was "ok", 54 standard errors off."""
    noisy, loud = tmp_path / "noisy.csv", tuple(3 * x for x in NOISE)
    write_recording(step_recording(CML050, lead=0.02, duration=0.1, noise=loud, seed=3), noisy)
    result = estimated(foreign_fmu(tmp_path, "EULER"), noisy)
    (reason,) = result.reasons
    assert "the FMU's own step error matters" in reason
    assert all((p.status, p.reason) == ("doubtful", reason) for p in result.parameters.values())


def test_euler_inside_gets_the_step_warning_and_the_right_answer_at_the_finer_step(tmp_path):
    noisy = tmp_path / "noisy.csv"
    write_recording(step_recording(CML050, lead=0.02, duration=0.1, noise=NOISE, seed=3), noisy)
    fmu = foreign_fmu(tmp_path, "EULER")
    coarse = estimated(fmu, noisy)
    assert coarse.verdict == "doubtful" and worst(coarse) > 0.02
    assert any("the FMU's own step error matters" in r and "under [fmu]" in r for r in coarse.reasons)
    fine = estimated(fmu, noisy, text=CASE.replace("[inputs]", "step = 1e-6\n[inputs]"))
    assert not any("step error" in r for r in fine.reasons)
    exact = estimated(foreign_fmu(tmp_path / "exact"), noisy)
    for name in NAMES:
        error = exact.parameters[name].standard_error
        assert abs(fine.parameters[name].value - exact.parameters[name].value) < 0.3 * error
        assert abs(fine.parameters[name].value - CML050.parameters[name]) < 5 * error


def test_a_start_time_that_is_not_zero(tmp_path, recording):
    change = [('startTime="0" stopTime="1"', 'startTime="5" stopTime="6"')]
    assert worst(estimated(foreign_fmu(tmp_path, "STARTS_AT 5.0", change=change), recording)) < 1e-8


def test_a_stop_time_of_its_own_gives_way_to_the_recordings(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, "OWN_STOP 0.2", change=[('stopTime="1"', 'stopTime="0.2"')])
    assert worst(estimated(fmu, recording)) < 1e-8


def test_a_stop_time_that_is_enforced_is_told(tmp_path, recording):
    fmu = foreign_fmu(tmp_path, "STOPS_AT 0.2", change=[('stopTime="1"', 'stopTime="0.2"')])
    with pytest.raises(SimulationError) as caught:
        estimated(fmu, recording)
    assert str(caught.value) == (
        "every simulation of foreign.fmu failed: doStep returned Discard at t = 0.2 s; the FMU's own stop time is 0.2 s"
        " and it goes no further; use a shorter recording, or export the FMU with a later stop time"
    )


def test_an_fmu_of_one_step_size_is_estimated_at_that_step(tmp_path, recording):
    e = estimated(foreign_fmu(tmp_path, "ONLY_STEP"), recording)
    assert worst(e) < 1e-8
    assert "the step could not be checked: the FMU fails at 0.0001 s, a tenth of the step" in e.notes


def test_an_fmu_of_one_step_size_is_told_at_another(tmp_path, recording):
    text = CASE.replace("[inputs]", "step = 5e-4\n[inputs]")
    sentence = r"Discard at t = 0 s; the FMU's own step size is 0.001 s, not 0.0005 s; set step = 0.001 under \[fmu\]"
    with pytest.raises(SimulationError, match=sentence):
        estimated(foreign_fmu(tmp_path, "ONLY_STEP"), recording, text=text)


def test_a_step_that_is_ignored_is_told(tmp_path, recording):
    e = estimated(foreign_fmu(tmp_path, "OWN_STEP"), recording)
    assert e.verdict == "doubtful" and worst(e) < 1e-8
    assert [r for r in e.reasons if r.startswith("the FMU ignores the communication step that it is given")]
    assert not any("step error" in r for r in e.reasons)


def test_a_discarded_step_costs_its_candidate_only(tmp_path, recording):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} return fmi2Discard;")
    e = estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)
    assert worst(e) < 1e-8
    assert e.failed_simulations > 0 and "doStep returned Discard (first with " in e.failures[0]


def test_a_value_that_the_fmu_refuses_is_named(tmp_path, recording):
    refusal = "for (size_t k = 0; k < n; k++) if (references[k] == 4 && values[k] < 1e6) return fmi2Discard;"
    fmu = faulty_fmu(tmp_path, SetReal=refusal)
    with pytest.raises(SimulationError, match=r"failed: set returned Discard for L \(first with R = .*, L = "):
        estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)


# What they do to their process


def test_a_flood_of_log_messages(tmp_path, recording):
    flood = """
static const fmi2CallbackFunctions *kept;
if (functions) kept = functions;
for (int k = 0; k < 10000; k++) kept->logger(kept->componentEnvironment, name, fmi2Warning, "logAll", "step %d", k);"""
    fmu = faulty_fmu(tmp_path, Instantiate=flood, Reset="return fmi2Error;")
    e = estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)
    assert worst(e) < 1e-8 and e.fmu["restart"] == "re-instantiate"


@pytest.mark.parametrize("command", ["estimate", "simulate"])
def test_an_fmu_that_crashes_always_is_told(tmp_path, recording, capsys, command):
    fmu = faulty_fmu(tmp_path, DoStep="abort();")
    source = [str(recording), "--fmu", str(fmu)] if command == "estimate" else [str(fmu)]
    assert main([command, *source]) == 2
    assert "crashed (SIGABRT)" in capsys.readouterr().err


def test_an_fmu_that_hangs_always_is_told(tmp_path, recording, monkeypatch):
    monkeypatch.setattr("estimator.fmus.probe_stages.STAGE_LIMIT", 1.0)
    fmu = faulty_fmu(tmp_path, DoStep="for (;;) pause();")
    with pytest.raises(FmuError, match=r"faulty.fmu cannot be used: it does not run: it does not come back within 1 s"):
        estimate(case_for_recording(recording, fmu=str(fmu)), workers=2)


# Binaries


@pytest.mark.parametrize("command", ["estimate", "simulate"])
def test_no_binary_for_this_platform_is_told(tmp_path, recording, capsys, command):
    fmu = foreign_fmu(tmp_path)
    with zipfile.ZipFile(fmu) as old:
        text = old.read("modelDescription.xml")
    with zipfile.ZipFile(fmu, "w") as new:
        new.writestr("modelDescription.xml", text)
        new.writestr("binaries/linux32/foreign.so", b"")
    source = [str(foreign_case(fmu, recording))] if command == "estimate" else [str(fmu)]
    assert main([command, *source]) == 2
    assert "foreign.fmu has no binary for" in capsys.readouterr().err
    assert main(["inspect", str(fmu)]) == 0
    assert "export it for this platform" in capsys.readouterr().out


def test_a_source_only_fmu_is_told_and_works_once_compiled(tmp_path, recording):
    fmu = tmp_path / "source.fmu"
    with zipfile.ZipFile(fmu_build.bundled("dc_motor")) as old, zipfile.ZipFile(fmu, "w") as new:
        for name in old.namelist():
            if not name.startswith("binaries/"):
                new.writestr(name, old.read(name))
    with pytest.raises(FmuError, match=r"compile its sources with: python -m fmpy compile source.fmu"):
        estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)
    if shutil.which("cmake") is None:
        pytest.skip("fmpy compiles with CMake, which is not there")
    subprocess.run([sys.executable, "-m", "fmpy", "compile", fmu.name], cwd=tmp_path, check=True, capture_output=True)
    assert worst(estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)) < 1e-8


def test_a_binary_that_is_none_is_told(tmp_path, recording):
    fmu = foreign_fmu(tmp_path)
    with zipfile.ZipFile(fmu) as old:
        text = old.read("modelDescription.xml")
    with zipfile.ZipFile(fmu, "w") as new:
        new.writestr("modelDescription.xml", text)
        new.writestr(f"binaries/{fmpy.platform}/foreign{fmpy.sharedLibraryExtension}", b"no library")
    with pytest.raises(FmuError, match=r"foreign.fmu cannot be used: it does not run: Failed to load shared library"):
        estimated(fmu, recording)


def test_a_wrong_guid_is_told(tmp_path, recording):
    fmu = bundled_copy(tmp_path, [(describe("dc_motor").guid, "{another}")])
    for kind in ("co-simulation", "model-exchange"):
        case = dataclasses.replace(case_for_recording(recording, fmu=str(fmu)), kind=kind)
        with pytest.raises(FmuError, match=r"copy.fmu cannot be used: .* gave no instance: wrong GUID: this binary"):
            estimate(case, workers=1)


def test_a_wrong_identifier_is_told(tmp_path, recording):
    fmu = bundled_copy(tmp_path, [('modelIdentifier="dc_motor"', 'modelIdentifier="motor"')])
    with pytest.raises(FmuError, match=r"copy.fmu .*: it has no library motor.so in binaries/\w+, only dc_motor.so"):
        estimate(case_for_recording(recording, fmu=str(fmu)), workers=1)


# Descriptions


@pytest.mark.parametrize("version", [3, pytest.param(2, marks=pytest.mark.full)])
def test_a_description_that_fails_validation_is_a_warning(tmp_path, recording, capsys, version):
    fmu = foreign_fmu(tmp_path, version=version, change=[("<ModelVariables>", '<ModelVariables strange="1">')])
    assert worst(estimated(fmu, recording)) < 1e-8
    assert main(["inspect", str(fmu), "--static"]) == 0
    assert "What the validation found" in capsys.readouterr().out


def test_a_start_that_is_no_number_does_not_stop_an_estimate(tmp_path, recording):
    change = [('(valueReference="0"[^>]*><Real unit="Ohm"[^>]*) start="[^"]*"', r'\1 start="cold"')]
    fmu = foreign_fmu(tmp_path, change=change)
    assert worst(estimated(fmu, recording)) < 1e-8


def test_limits_that_contradict_themselves_are_a_warning(tmp_path, recording, capsys):
    change = [
        ('(valueReference="0"[^>]*><Real unit="Ohm")', r'\1 min="8" max="0.5"'),
        ('(valueReference="4"[^>]*><Real unit="kg.m2")', r'\1 max="9.5e-06"'),
    ]
    fmu = foreign_fmu(tmp_path, change=change)
    e = estimated(fmu, recording)
    assert worst(e) < 1e-8 and e.parameters["J"].upper == 9.5e-6
    assert main(["inspect", str(fmu), "--static"]) == 0
    text = capsys.readouterr().out
    assert "motor.Ra has min 8 above max 0.5; its limits are not used" in text
    assert "motor.Jm starts at 1e-05, outside its own limits" in text


# The table in the documentation


def test_the_table_of_quirks_names_every_test_here_and_no_other():
    tests = Path(__file__).parent
    named = set(re.findall(r"`((?:test_\w+|\w+)\.py)::(test_\w+)`", TABLE.read_text(encoding="utf-8")))
    for file, test in named:
        tree = ast.parse((tests / file).read_text(encoding="utf-8"))
        assert test in {n.name for n in tree.body if isinstance(n, ast.FunctionDef)}, f"{file} has no {test}"
    here = {
        n.name for n in ast.parse(Path(__file__).read_text(encoding="utf-8")).body if isinstance(n, ast.FunctionDef)
    }
    own = {n for n in here if n.startswith("test_") and "table_of_quirks" not in n}
    assert own <= {test for _, test in named}
