"""The command line: usage, exit status, what goes where. The estimation itself is replaced by a made one here."""

import dataclasses
import errno
import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from made_estimates import MOTOR, UNITS, estimate
from test_report import check_contract

import estimator.estimating.estimate
import estimator.fmus.fmu
import estimator.fmus.probe
import estimator.fmus.simulate
from estimator.cases.case import Case, ParameterSpec, SearchSpec
from estimator.cli import main
from estimator.errors import InputError, SimulationError
from estimator.estimating.progress import Progress
from estimator.fmus.fmu import FmuDescription
from estimator.fmus.variable import Variable
from estimator.recordings.reading import read_recording

ROOT = Path(__file__).parent.parent


def variable(name: str, causality: str, unit: str, **more) -> Variable:
    return Variable(name, hash(name) % 1000, "Real", causality, "continuous", unit, f"the {name}", **more)


DESCRIPTION = FmuDescription(
    path=Path("motor.fmu"),
    name="motor",
    fmi_version="2.0",
    model_name="motor",
    guid="{1}",
    generation_tool="by hand",
    identifier="motor",
    kinds=("co-simulation",),
    platforms=("linux64", "win64", "darwin64"),
    variables=(
        *(variable(name, "parameter", unit, start=1.0, minimum=0.0) for name, unit in UNITS.items()),
        variable("v", "input", "V"),
        variable("load", "input", "N.m", start=0.0),
        variable("i", "output", "A"),
        variable("w", "output", "rad/s"),
    ),
    capabilities={"canGetAndSetFMUstate": True, "needsExecutionTool": False},
    default_experiment={"start_time": 0.0, "stop_time": 2.8, "step_size": 1e-3, "tolerance": None},
    warnings=(),
)


@pytest.fixture
def calls(monkeypatch, tmp_path):
    """Replace FMU, estimation and simulation; return how they were called. The working folder is an empty one."""
    seen = SimpleNamespace(case=None, workers=None, simulated=None, result=estimate(), error=None)

    def run(case, *, workers=None, progress=None, tell=None, profile=False):
        seen.case, seen.workers, seen.profile = case, workers, profile
        if progress is not None:
            progress(Progress("search", 10, 100, 1.0, {"R": 3.0}))
        if seen.error is not None:
            raise seen.error
        return seen.result

    def simulate(fmu, *, parameters, inputs, times):
        seen.simulated = SimpleNamespace(parameters=parameters, inputs=inputs, times=times)
        return {"i": np.sin(times), "w": 100 * np.cos(times)}

    monkeypatch.setattr(estimator.estimating.estimate, "estimate", run)
    monkeypatch.setattr(estimator.fmus.simulate, "simulate", simulate)
    monkeypatch.setattr(estimator.fmus.fmu, "describe", lambda fmu, **_: DESCRIPTION)
    monkeypatch.setattr(estimator.fmus.probe, "driven", lambda description: description)
    monkeypatch.chdir(tmp_path)
    return seen


def fails(capsys, *arguments: str, status: int = 2) -> str:
    """Run a command that must fail with one sentence on stderr and nothing on stdout; return the sentence."""
    assert main(arguments) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1 and err.endswith("\n") and err.startswith("fmu-estimator")
    return err.split(": ", 1)[1].rstrip("\n")


# --- usage ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("", "the following arguments are required: COMMAND; see fmu-estimator --help"),
        (
            "estimat x",
            "there is no command 'estimat'; did you mean 'estimate'? (demo, estimate, simulate, inspect, ",
        ),
        ("x", "there is no command 'x' (demo, estimate, simulate, inspect, "),
        (
            "estimate",
            "the following arguments are required: CASE.case.toml|RECORDING; see fmu-estimator estimate --help",
        ),
        ("estimate x --foo", "unrecognized arguments: --foo; see fmu-estimator estimate --help"),
        ("estimate x --metod paper", "unrecognized arguments: --metod; did you mean '--method'?"),
        ("estimate --fixx=L=1 x", "unrecognized arguments: --fixx; did you mean '--fix'?"),
        ("--verson", "unrecognized arguments: --verson; did you mean '--version'?"),
        ("estimate x --fix L", "argument --fix: 'L' is not NAME=VALUE, such as L=0.013"),
        ("estimate x --column v", "argument --column: 'v' is not NAME=TEXT, such as v=U1"),
        ("estimate x --unit w", "argument --unit: 'w' is not NAME=TEXT, such as w=rpm"),
        ("estimate x --fix =1", "argument --fix: '=1' is not NAME=VALUE, such as L=0.013"),
        ("estimate x --fix L=a", "argument --fix: 'a' in 'L=a' is not a number"),
        ("estimate x --fix L=nan", "argument --fix: 'nan' in 'L=nan' is not a number"),
        ("estimate x --bounds R=1", "argument --bounds: 'R=1' is not NAME=LOWER:UPPER, such as R=0.1:5"),
        ("estimate x --bounds R=5:0.1", "argument --bounds: 'R=5:0.1' is upside down; write R=0.1:5"),
        ("estimate x --bounds R=5:5", "argument --bounds: 'R=5:5' leaves no room; use --fix R=5"),
        ("estimate x --bounds R=a:5", "argument --bounds: 'a' in 'R=a:5' is not a number"),
        ("estimate x --bounds R=1:inf", "argument --bounds: 'inf' in 'R=1:inf' is not a number"),
        ("estimate x --workers 0", "argument --workers: '0' is not a whole number of at least 1"),
        ("estimate x --workers two", "argument --workers: 'two' is not a whole number of at least 1"),
        ("estimate x --seed -1", "argument --seed: '-1' is not a whole number of at least 0"),
        (
            "estimate x --method ga",
            "argument --method: invalid choice: 'ga' (choose from 'cuckoo', 'paper', 'original', 'integral',"
            " 'steiglitz-mcbride', 'differential-evolution')",
        ),
        ("simulate m --voltage-step 10", "argument --voltage-step: '10' is not VOLTAGE@TIME, such as 10.5@0.5"),
        ("simulate m --voltage-step a@1", "argument --voltage-step: 'a' in 'a@1' is not a number"),
        (
            "simulate m --voltage-step 1@0 --input x",
            "argument --input: not allowed with argument --voltage-step",
        ),
        ("estimate=", "argument CASE.case.toml|RECORDING: '' names nothing"),
        ("estimate x -o=", "argument -o: '' names nothing"),
        ("simulate m --step 0", "argument --step: '0' is not positive"),
        ("simulate m --stop x", "argument --stop: 'x' is not a number"),
        ("build m --fmi 1", "argument --fmi: '1' is no version of FMI that can be built; use --fmi 2 or --fmi 3"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(arguments, sentence, capsys):
    words = [part for word in arguments.split() for part in ([word[:-1], ""] if word[-1] == "=" else [word])]
    told = fails(capsys, *words)
    assert told.partition("; see")[0].startswith(sentence.partition("; see")[0])


@pytest.mark.parametrize("command", ["", "demo", "estimate", "simulate", "inspect", "build"])
def test_help_is_printed_with_examples(command, capsys):
    assert main([*command.split(), "--help"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("usage: fmu-estimator") and "\nexamples:\n  fmu-estimator " in out


def test_the_version_is_that_of_the_project(capsys):
    assert main(["--version"]) == 0
    declared = (ROOT / "pyproject.toml").read_text().split('version = "')[1].split('"')[0]
    assert capsys.readouterr().out == f"fmu-estimator {declared}\n"


@pytest.mark.parametrize("option", ["--help", "--version", "estimate --help"])
def test_help_and_version_import_nothing_heavy(option):
    code = (
        "import sys; from estimator.cli import main; status = main(sys.argv[1:]);"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'fmpy', 'lxml'} & set(sys.modules);"
        "sys.exit(f'imported {heavy}' if heavy else status)"
    )
    done = subprocess.run([sys.executable, "-c", code, *option.split()], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_python_m_estimator_is_the_command_line():
    done = subprocess.run([sys.executable, "-m", "estimator", "nothing"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("fmu-estimator: there is no command 'nothing'")


# --- estimate ------------------------------------------------------------------------------------------------------


def test_an_estimate_is_a_text_on_stdout_and_nothing_is_written(calls, capsys, tmp_path):
    assert main(["estimate", "step.csv"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("OK") and err == "", "no progress where there is no terminal"
    assert list(tmp_path.iterdir()) == []
    assert calls.case == Case(recordings=(tmp_path / "step.csv",)) and calls.workers is None
    assert not calls.profile, "it is for the report"


def test_json_is_one_object_and_nothing_else(calls, capsys):
    assert main(["estimate", "step.csv", "--json"]) == 0
    result = check_contract(capsys.readouterr().out)
    assert {name: p["value"] for name, p in result["parameters"].items()} == MOTOR


@pytest.mark.parametrize(("verdict", "status"), [("ok", 0), ("doubtful", 0), ("refused", 1)])
@pytest.mark.parametrize("json_too", [False, True])
def test_the_verdict_decides_the_exit_status(calls, capsys, verdict, status, json_too):
    calls.result = estimate(verdict=verdict, reasons=("because",))
    assert main(["estimate", "step.csv", *(["--json"] if json_too else [])]) == status
    out, err = capsys.readouterr()
    assert "because" in out and err == ""
    if json_too:
        assert check_contract(out)["verdict"] == verdict


def test_a_failed_simulation_is_status_1_and_with_json_still_an_object(calls, capsys):
    calls.error = SimulationError("every simulation of motor.fmu failed: it crashed")
    assert fails(capsys, "estimate", "step.csv", status=1) == str(calls.error)
    assert main(["estimate", "step.csv", "--json", "--seed", "7", "--method", "paper"]) == 1
    out, err = capsys.readouterr()
    result = check_contract(out)
    assert (result["verdict"], result["reasons"]) == ("refused", [str(calls.error)])
    assert (result["seed"], result["method"]) == (7, "paper")
    assert str(calls.error) in err


def test_bad_input_is_status_2_with_nothing_on_stdout_also_with_json(calls, capsys):
    calls.error = InputError("run.csv line 3: current is\nnot a number")
    for more in ([], ["--json"]):
        told = fails(capsys, "estimate", "run.csv", *more)
        assert told == "run.csv line 3: current is not a number", "one sentence on one line"


def test_options_reach_the_case(calls):
    fmu = str(Path("other.fmu").absolute())
    options = "--fmu other.fmu --method paper --seed 7 --workers 3 --fix L=0.013 --bounds R=0.1:5 --quiet"
    assert main(["estimate", "step.csv", *options.split()]) == 0
    assert (calls.case.fmu, calls.workers) == (fmu, 3)
    assert calls.case.search == SearchSpec(method="paper", seed=7)
    assert calls.case.fixed == {"L": 0.013}
    assert set(calls.case.parameters) == {"R", "K", "J", "B"}, "bounds for one do not hold the others"
    assert (calls.case.parameters["R"].minimum, calls.case.parameters["R"].maximum) == (0.1, 5.0)


def test_a_bundled_name_stays_a_name(calls):
    assert main(["estimate", "step.csv", "--fmu", "dc_motor"]) == 0
    assert calls.case.fmu == "dc_motor"


CASE = """
[fmu]
path = "dc_motor"
[parameters]
Kt = { min = 0.01, max = 0.1, start = 0.05, fmu = ["K"] }
R = { nominal = 3.0 }
[fixed]
B = 1e-4
[[recording]]
file = "step.csv"
[search]
seed = 5
"""


@pytest.fixture
def case_file(tmp_path):
    (tmp_path / "m.case.toml").write_text(CASE)
    (tmp_path / "step.csv").write_text("")
    return "m.case.toml"


def test_a_case_file_is_read_and_options_win_over_it(calls, case_file):
    assert main(["estimate", case_file, "--bounds", "Kt=0.06:0.2", "--bounds", "B=0:1", "--method", "paper"]) == 0
    assert calls.case.search == SearchSpec(method="paper", seed=5)
    assert calls.case.parameters["Kt"] == ParameterSpec("Kt", 0.06, 0.2, start=0.06, fmu=("K",))
    assert calls.case.parameters["B"] == ParameterSpec("B", 0.0, 1.0), "bounds set a fixed parameter free"
    assert calls.case.fixed == {}


def test_a_fixed_parameter_of_a_case_sets_its_variables_in_the_fmu(calls, case_file):
    assert main(["estimate", case_file, "--fix", "Kt=0.05"]) == 0
    assert set(calls.case.parameters) == {"R"} and calls.case.fixed == {"B": 1e-4, "K": 0.05}


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ("--fix Rs=1", "motor.fmu has no parameter 'Rs'; did you mean 'R'? (R, K, L, J, B, v, load)"),
        ("--bounds Q=1:2", "motor.fmu has no parameter 'Q' (R, K, L, J, B, v, load)"),
        ("--fix R=-1", "--fix R=-1 is outside the range 0 to any that motor.fmu allows"),
        ("--fix R=1 --fix R=2", "--fix is given twice for 'R'; leave one out"),
        ("--bounds R=1:2 --bounds R=2:3", "--bounds is given twice for 'R'; leave one out"),
        ("--fix R=1 --bounds R=1:2", "'R' is given to --fix and to --bounds; leave one out"),
    ],
)
def test_parameters_are_checked_against_the_fmu(calls, capsys, options, sentence):
    assert fails(capsys, "estimate", "step.csv", *options.split()) == sentence


def test_fixing_all_that_a_case_estimates_is_refused(calls, capsys, case_file, monkeypatch):
    strange = dataclasses.replace(
        DESCRIPTION, variables=(variable("Rs", "parameter", "Ohm"), variable("v", "input", "V"))
    )
    monkeypatch.setattr(estimator.fmus.fmu, "describe", lambda fmu, **_: strange)
    Path(case_file).write_text('[parameters]\nRs = {}\n[[recording]]\nfile = "step.csv"\n')
    assert fails(capsys, "estimate", case_file, "--fix", "Rs=1") == (
        "every parameter is fixed; leave at least one free"
    )


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        ("motor.toml", "motor.toml: the name of a case file ends in .case.toml; rename it"),
        (
            "motor.fmu",
            "motor.fmu is an FMU; give a recording or a case file, and the FMU with --fmu motor.fmu",
        ),
    ],
)
def test_what_is_neither_a_recording_nor_a_case_file_is_told(calls, capsys, source, sentence):
    assert fails(capsys, "estimate", source) == sentence


@pytest.mark.skipif(sys.platform != "linux", reason="file names are text elsewhere")
@pytest.mark.parametrize(
    "words",
    [
        ("estimate", "b\udcffd.csv"),
        ("estimate", "step.csv", "-o", "b\udcff"),
        ("check", "b\udcffd.csv"),
        ("inspect", "b\udcff.fmu"),
        ("estimate", "b*d.csv"),
        ("estimate", "line.case.toml"),
    ],
)
def test_a_file_name_that_is_no_text_is_refused_before_anything_is_done(calls, capsys, words):
    Path("b\udcffd.csv").write_text("")
    Path("line.case.toml").write_text('[[recording]]\nfile = "b*d.csv"\n')
    sentence = fails(capsys, *words)
    assert "\\udcff" in sentence and "no UTF-8 text; rename" in sentence


@pytest.mark.smoke
def test_o_writes_the_four_files_and_removes_stale_ones(calls, capsys, tmp_path):
    assert main(["estimate", "step.csv", "-o", "out", "--json"]) == 0
    printed = capsys.readouterr().out
    folder = tmp_path / "out"
    assert calls.profile
    assert {p.name for p in folder.iterdir()} == {"result.json", "report.html", "parameters.ssv", "figure.png"}
    assert (folder / "result.json").read_text() == printed
    assert "fmu-estimator estimate step.csv -o out --json" in (folder / "report.html").read_text()
    calls.result = estimate(verdict="refused", reasons=("no",), parameters={}, comparisons=(), history=None)
    assert main(["estimate", "step.csv", "-o", "out"]) == 1
    assert {p.name for p in folder.iterdir()} == {"result.json", "report.html"}


def test_figures_for_print_are_written_and_go_when_they_are_not_asked_for(calls, capsys, tmp_path):
    figures = {"figure.png", "figure.svg", "figure.pdf"}
    assert main(["estimate", "step.csv", "-o", "out", "--figures", "svg", "--figures", "pdf"]) == 0
    assert {p.name for p in (tmp_path / "out").glob("figure.*")} == figures
    assert main(["estimate", "step.csv", "-o", "out"]) == 0
    assert {p.name for p in (tmp_path / "out").glob("figure.*")} == {"figure.png"}
    capsys.readouterr()
    said = fails(capsys, "estimate", "step.csv", "--figures", "svg")
    assert said == "--figures needs a folder to write to; give one with -o"


def test_o_that_cannot_be_written_is_told_before_anything_is_estimated(calls, capsys, tmp_path):
    (tmp_path / "file").touch()
    assert fails(capsys, "estimate", "x.csv", "-o", "file") == "file is a file, not a folder; give -o another name"
    assert "cannot write there" in fails(capsys, "estimate", "x.csv", "-o", "file/sub")
    assert calls.case is None


def test_a_failure_leaves_no_folder_behind(calls, capsys, tmp_path):
    calls.error = InputError("no")
    fails(capsys, "estimate", "x.csv", "-o", "a/b")
    assert list(tmp_path.iterdir()) == []


# --- what goes wrong on the way ------------------------------------------------------------------------------------


def test_an_unexpected_error_is_a_sentence_that_tells_how_to_see_more(calls, capsys, monkeypatch):
    calls.error = ZeroDivisionError("division by zero")
    told = fails(capsys, "estimate", "x.csv", status=1)
    assert told == "internal error, ZeroDivisionError: division by zero; set FMU_ESTIMATOR_DEBUG=1 to see where"
    monkeypatch.setenv("FMU_ESTIMATOR_DEBUG", "1")
    assert main(["estimate", "x.csv"]) == 1
    err = capsys.readouterr().err
    assert "Traceback" in err and err.endswith("internal error, ZeroDivisionError: division by zero\n")


@pytest.mark.parametrize(
    ("error", "status", "sentence"),
    [
        (PermissionError(errno.EACCES, "Permission denied", "x.csv"), 2, "x.csv: Permission denied"),
        (OSError(errno.EMFILE, "Too many open files"), 1, "Too many open files"),
        (MemoryError(), 1, "not enough memory; make it shorter, or give fewer --workers"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (
            estimator.estimating.estimate.Interrupted({"R": 3.1, "J": 9e-6}),
            130,
            "interrupted; the best so far: R=3.1 J=9e-06",
        ),
        (estimator.estimating.estimate.Interrupted(None), 130, "interrupted"),
    ],
)
def test_the_world_outside_fails_in_one_sentence(calls, capsys, error, status, sentence):
    calls.error = error
    assert fails(capsys, "estimate", "x.csv", status=status) == sentence


def test_a_compiler_that_is_missing_is_bad_input(capsys, monkeypatch, tmp_path):
    import fmu_build

    def no_compiler(model, **_):
        raise fmu_build.BuildError("no C compiler; install gcc")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fmu_build, "build", no_compiler, raising=False)
    assert fails(capsys, "build", "dc_motor") == "no C compiler; install gcc"


def test_a_reader_that_goes_away_ends_the_command_quietly():
    code = "import sys; from estimator.cli import main; sys.exit(main(['estimate', '--help']))"
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert done.returncode in (0, 141) and done.stderr == "", "argparse itself may have seen it"


def test_output_to_a_closed_pipe_is_status_141_and_silent(tmp_path):
    code = (
        "import sys, estimator.estimating.estimate as e; sys.path.insert(0, 'tests'); import made_estimates as m;"
        "e.estimate = lambda case, **_: m.estimate();"
        "from estimator.cli import main; sys.exit(main(['estimate', 'x.csv']))"
    )
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_an_ascii_terminal_gets_the_report_spelled_out():
    code = (
        "import sys, estimator.estimating.estimate as e; sys.path.insert(0, 'tests'); import made_estimates as m;"
        "e.estimate = lambda case, **_: m.estimate(reasons=('3 Ω ≥ 2, ☃, w ← n, 5 µA',));"
        "from estimator.cli import main; sys.exit(main(['estimate', 'x.csv']))"
    )
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "+/- 0.0031" in done.stdout and "3 Ohm >= 2, ?, w <- n, 5 uA" in done.stdout


# --- progress ------------------------------------------------------------------------------------------------------


def on_terminal(calls, monkeypatch, *arguments: str) -> str:
    """Run a command with stderr on a terminal; return what the terminal got."""
    master, slave = pty.openpty()
    with os.fdopen(slave, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        assert main(["estimate", "step.csv", *arguments]) == 0
        terminal.write("END")
        terminal.flush()
        got = ""
        while not got.endswith("END"):  # a terminal delivers in pieces
            got += os.read(master, 10_000).decode()
    os.close(master)
    return got


def test_progress_is_shown_on_a_terminal_and_wiped(calls, monkeypatch, capsys):
    got = on_terminal(calls, monkeypatch, "--json")
    shown = re.fullmatch(r"\r(search  10 of 100 simulations  .*cost 1  R 3)\r( +)\rEND", got)
    assert shown and len(shown[1]) == len(shown[2]), repr(got)
    check_contract(capsys.readouterr().out)


def test_quiet_shows_no_progress(calls, monkeypatch, capsys):
    assert on_terminal(calls, monkeypatch, "--quiet") == "END"


# --- simulate ------------------------------------------------------------------------------------------------------


def test_a_voltage_step_is_simulated_at_rest_first(calls, capsys):
    arguments = "simulate motor.fmu --set R=1.2 --set load=0.01 --voltage-step 10.5@0.5 --stop 1 --step 0.1"
    assert main(arguments.split()) == 0
    seen = calls.simulated
    assert seen.parameters == {"R": 1.2}
    assert np.allclose(seen.times, np.linspace(0, 1, 11), rtol=0, atol=1e-15)
    assert seen.inputs["v"].tolist() == [0.0] * 5 + [10.5] * 6
    assert seen.inputs["load"].tolist() == [0.01] * 11


def test_a_voltage_step_after_the_end_is_an_error(calls, capsys):
    """It simulated rest alone, without a word."""
    told = fails(capsys, "simulate", "motor.fmu", "--voltage-step", "10@5")
    assert "the voltage step at 5 s is after the end at 2.8 s; give a longer --stop" in told


def test_the_default_is_the_papers_record(calls, capsys):
    assert main(["simulate", "motor.fmu"]) == 0
    assert calls.simulated.inputs == {} and len(calls.simulated.times) == 2801
    assert calls.simulated.times[-1] == pytest.approx(2.8, abs=1e-12)


def test_a_simulation_reads_back_as_a_recording_to_the_bit(calls, capsys, tmp_path):
    assert main(["simulate", "motor.fmu", "--voltage-step", "-10.5@0.5", "-o", "out.csv"]) == 0
    assert capsys.readouterr().out == ""
    read_back = read_recording(tmp_path / "out.csv")
    assert read_back.units == {"v": "V", "i": "A", "w": "rad/s"}
    assert np.array_equal(read_back.signals["w"], 100 * np.cos(calls.simulated.times))
    assert read_back.signals["v"].min() == -10.5
    assert main(["simulate", "motor.fmu", "--voltage-step", "-10.5@0.5"]) == 0
    assert capsys.readouterr().out == (tmp_path / "out.csv").read_text()


def test_inputs_come_from_a_recording_by_name_or_by_their_usual_names(calls, capsys, tmp_path):
    rows = "\n".join(f"{k / 1000},{k},{-k},{7}" for k in range(20))
    (tmp_path / "drive.csv").write_text(f"time [s],voltage [mV],load torque [N.m],current [A]\n{rows}\n")
    assert main(["simulate", "motor.fmu", "--input", "drive.csv"]) == 0
    assert calls.simulated.inputs["v"].tolist() == [k / 1000 for k in range(20)]
    assert calls.simulated.inputs["load"].tolist() == [-k for k in range(20)]
    assert len(calls.simulated.times) == 20


def test_the_examples_of_simulate_run(calls, capsys, tmp_path):
    (tmp_path / "drive.csv").write_text("time [s],v [V]\n" + "\n".join(f"{k / 1000},{k}" for k in range(20)))
    assert main(["simulate", "--help"]) == 0
    examples = capsys.readouterr().out.partition("\nexamples:\n")[2].splitlines()
    assert len(examples) == 2
    for example in examples:
        assert main(example.split()[1:]) == 0, example


def simulate_fails(capsys, rest: str) -> str:
    return fails(capsys, "simulate", "motor.fmu", *rest.split())


def test_wrong_simulations_are_told_in_one_sentence(calls, capsys, tmp_path, monkeypatch):
    rows = "\n".join(f"{k / 1000},{k if k != 3 else ''}" for k in range(20))
    (tmp_path / "gap.csv").write_text(f"time [s],v [V]\n{rows}\n")
    (tmp_path / "other.csv").write_text(f"time [s],x [V]\n{rows}\n")
    assert simulate_fails(capsys, "--set Rs=1") == (
        "motor.fmu has no parameter 'Rs'; did you mean 'R'? (R, K, L, J, B, v, load)"
    )
    assert simulate_fails(capsys, "--set R=1 --set R=2") == "--set is given twice for 'R'; leave one out"
    assert simulate_fails(capsys, "--set v=1 --voltage-step 1@0") == (
        "the input 'v' is given twice, by --set and by the drive; leave one out"
    )
    assert simulate_fails(capsys, "--stop 1 --step 2") == "--step 2 is longer than --stop 1; give a smaller step"
    assert simulate_fails(capsys, "--input gap.csv --stop 1") == (
        "--stop and --step come from the file of --input; leave them out"
    )
    assert simulate_fails(capsys, "--input gap.csv") == (
        "gap.csv: v has no sample at t = 0.003 s; an input needs them all"
    )
    assert simulate_fails(capsys, "--input other.csv") == (
        "other.csv: no column is an input of motor.fmu (its inputs: v, load); name a column after an input"
    )
    assert "no/out.csv: cannot be written" in simulate_fails(capsys, "-o no/out.csv")
    unclear = dataclasses.replace(DESCRIPTION, variables=(variable("a", "input", ""), variable("b", "input", "")))
    monkeypatch.setattr(estimator.fmus.fmu, "describe", lambda fmu, **_: unclear)
    assert simulate_fails(capsys, "--voltage-step 1@0") == (
        "motor.fmu: it is not clear which input is the voltage (a, b); use --input FILE"
    )


# --- inspect and build ---------------------------------------------------------------------------------------------


def test_inspect_tells_what_can_be_estimated(calls, capsys):
    assert main(["inspect", "motor.fmu", "--static"]) == 0
    out = capsys.readouterr().out
    assert "FMI           2.0, co-simulation" in out
    assert "Nothing keeps it from use here." in out
    for name in (*UNITS, "v", "load", "i", "w"):
        assert f"\n  {name} " in out


def test_inspect_tells_what_would_go_wrong(calls, capsys, monkeypatch):
    bare = dataclasses.replace(
        DESCRIPTION,
        variables=(),
        warnings=("line 3: no start value",),
        capabilities={"needsExecutionTool": True},
    )
    monkeypatch.setattr(estimator.fmus.fmu, "describe", lambda fmu, **_: bare)
    assert main(["inspect", "motor.fmu", "--static", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["problems"] == [
        "it needs its tool, by hand, to be installed and running",
        "it has no real parameter, so nothing can be estimated",
        "it has no real output and no other variable to compare a recording with",
    ]
    assert found["remarks"] == ["it has no inputs: a recording shows how it moves by itself, from where it begins"]
    assert main(["inspect", "motor.fmu", "--static"]) == 0
    out = capsys.readouterr().out
    assert "What would go wrong:\n  - it needs its tool" in out and "line 3: no start value" in out


def test_inspect_json_has_the_variables(calls, capsys):
    assert main(["inspect", "motor.fmu", "--static", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [v["name"] for v in found["parameters"]] == list(UNITS)
    assert found["parameters"][0]["unit"] == "Ohm" and found["parameters"][0]["min"] == 0.0
    assert [v["name"] for v in found["inputs"]] == ["v", "load"]
    assert found["kinds"] == ["co-simulation"] and found["fmi_version"] == "2.0"


def test_build_prints_where_the_fmu_is(capsys, monkeypatch, tmp_path):
    import fmu_build

    asked = []
    monkeypatch.chdir(tmp_path)

    def build(model, *, output, fmi, platforms):
        asked.append((model, output, fmi, platforms))
        return output

    monkeypatch.setattr(fmu_build, "build", build)
    assert main(["build", "models/my_motor.c"]) == 0
    assert main(["build", "dc_motor", "--fmi", "3", "--platforms", "linux64,win64", "-o", "out/x.fmu"]) == 0
    assert capsys.readouterr().out == "my_motor.fmu\nout/x.fmu\n"
    assert asked == [
        ("models/my_motor.c", Path("my_motor.fmu"), 2, None),
        ("dc_motor", Path("out/x.fmu"), 3, ["linux64", "win64"]),
    ]
    assert fails(capsys, "build", "dc_motor", "-o", ".") == (
        ". is a folder; give -o the name of a file, such as model.fmu"
    )
    assert fails(capsys, "build", "dc_motor", "-o", "x/") == (
        "x is a folder; give -o the name of a file, such as x/model.fmu"
    )


@pytest.mark.parametrize(
    ("command", "option"),
    [
        (("estimate", "own.csv", "--progress-json", "own.csv"), "--progress-json"),
        (("simulate", "dc_motor", "--input", "own.csv", "-o", "own.csv"), "-o"),
        (("build", "own.csv", "-o", "own.csv"), "-o"),
    ],
)
def test_no_command_writes_over_what_it_reads(command, option, capsys, monkeypatch, tmp_path):
    """A model's source became an FMU, a recording its own simulation, or the progress of its estimate."""
    monkeypatch.chdir(tmp_path)
    Path("own.csv").write_text(content := "time [s],voltage [V],speed [rad/s]\n0,0,0\n")
    assert fails(capsys, *command) == f"own.csv is what is read; give {option} another name"
    assert Path("own.csv").read_text() == content


# --- demo ----------------------------------------------------------------------------------------------------------


def test_the_demo_writes_its_five_files_and_can_be_run_again(calls, capsys, tmp_path):
    for _ in range(2):
        assert main(["demo"]) == 0
        folder = tmp_path / "fmu-estimator-demo"
        assert {p.name for p in folder.iterdir()} == {
            "recording.csv",
            "result.json",
            "report.html",
            "parameters.ssv",
            "figure.png",
        }
    out = capsys.readouterr().out
    assert "Mavilor CML-050" in out and str(folder.name) in out
    assert {name: spec.nominal for name, spec in calls.case.parameters.items()} == MOTOR
    assert calls.simulated.parameters == MOTOR
    voltage = calls.simulated.inputs["v"]
    assert len(voltage) == 2801 and voltage[499] == 0 and voltage[500] == 10.5


def test_the_demos_recording_has_the_benchs_noise(calls, capsys, tmp_path):
    assert main(["demo", "-o", "d"]) == 0
    recording = read_recording(tmp_path / "d" / "recording.csv")
    times = calls.simulated.times
    assert np.std(recording.signals["current"] - np.sin(times)) == pytest.approx(0.02, rel=0.05)
    assert np.std(recording.signals["speed"] - 100 * np.cos(times)) == pytest.approx(1.0, rel=0.05)


def test_the_demo_does_not_write_among_other_files(calls, capsys, tmp_path):
    (tmp_path / "thesis.tex").touch()
    assert fails(capsys, "demo", "-o", ".") == (
        ". already holds other files (thesis.tex); give -o an empty or a new folder"
    )
