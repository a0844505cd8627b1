"""The Python interface: ten names, lazily loaded, the same results as the command line."""

import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import forked
import numpy as np
import pytest
from made_estimates import estimate, with_parameter
from test_report import check_contract, parsed

import estimator
from estimator.api_words import in_python
from estimator.errors import RecordingError
from estimator.results.shown_result import Result

pytestmark = pytest.mark.usefixtures("shared_workers")

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"
NAMES = [
    "Case",
    "InputError",
    "Result",
    "SimulationError",
    "describe_fmu",
    "estimate_parameters",
    "read_case",
    "read_recording",
    "recording_from_arrays",
    "simulate_fmu",
]


def test_the_public_names_are_these_ten_and_all_are_documented():
    assert estimator.__all__ == NAMES == dir(estimator)
    for name in NAMES:
        assert inspect.getdoc(getattr(estimator, name)), name
    for name in ("estimate_parameters", "simulate_fmu", "describe_fmu", "read_recording", "recording_from_arrays"):
        assert "Raises\n------" in inspect.getdoc(getattr(estimator, name)), name


def test_another_name_is_told_which_there_are():
    with pytest.raises(AttributeError, match="no attribute 'identify'; public are Case, InputError"):
        _ = estimator.identify


def test_importing_the_package_loads_nothing():
    code = "import sys, estimator; print(*sorted(m for m in sys.modules if m.startswith(('estimator', 'numpy'))))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["estimator"]


@pytest.fixture(scope="module")
def result():
    return estimator.estimate_parameters(EXAMPLE, workers=1)


def test_it_finds_what_the_command_line_finds(result):
    done = forked.run("estimate", str(EXAMPLE), "--json", cwd=ROOT)
    told, printed = check_contract(result.to_json()), check_contract(done.stdout)
    for key in ("parameters", "verdict", "rmse", "simulations"):
        assert told[key] == printed[key]
    # LAPACK's last bit depends on where in memory a matrix stands
    for name, row in told["correlation"].items():
        assert printed["correlation"][name] == pytest.approx(row, rel=1e-12)


def test_recordings_and_cases_in_memory_are_taken_and_options_hold(result):
    recording = estimator.read_recording(EXAMPLE)
    again = estimator.estimate_parameters(recording, fix={"L": 0.013}, bounds={"R": (3.0, 3.3)}, seed=4, workers=1)
    assert again.values["L"] == 0.013 and again.standard_errors["L"] is None
    assert again.parameters["R"].lower == 3.0 and again.seed == 4
    case = estimator.Case(recordings=(EXAMPLE,))
    assert estimator.estimate_parameters(case, workers=1).parameters == result.parameters


@pytest.mark.parametrize("asked", [{"OPENBLAS_NUM_THREADS": "2"}, {}])
def test_the_linear_algebra_has_one_thread_while_an_estimation_runs_and_then_as_many_as_before(asked):
    script = f"""
import numpy, scipy.linalg, threadpoolctl, estimator, estimator.cli
estimator.cli.main(["estimate"])  # a command in a program that has loaded numpy
def threads(): return {{lib["num_threads"] for lib in threadpoolctl.threadpool_info() if lib["user_api"] == "blas"}}
before, seen = threads(), set()
estimator.estimate_parameters({str(EXAMPLE)!r}, workers=1, progress=lambda _: seen.update(threads()))
print(seen, threads() == before)
"""
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")} | asked
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "{1} True\n"


def test_a_file_of_several_tests_validates_what_was_fitted_in_memory(tmp_path):
    rows = [line for line in EXAMPLE.read_text().splitlines() if line[:1].isdigit()]
    path = tmp_path / "both.csv"
    header = "test,time [s],voltage [V],current [A],speed [rad/s]"
    path.write_text("\n".join([header, *(f"{k},{row}" for k in (1, 2) for row in rows)]) + "\n")
    found = estimator.estimate_parameters(estimator.read_recording(EXAMPLE), validate=[path], workers=1)
    held_out = json.loads(found.to_json())["validation"]["recordings"]
    assert [r["name"] if isinstance(r, dict) else r for r in held_out] == ["both 1", "both 2"]


def test_what_is_no_recording_is_told():
    with pytest.raises(estimator.InputError, match="a case file's name ends in .case.toml, an FMU is given as fmu="):
        estimator.estimate_parameters("motor.fmu")


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"seed": -1}, "seed=-1 is not a whole number of at least 0"),
        ({"seed": 1.5}, "seed=1.5 is not a whole number of at least 0"),
        ({"workers": 0}, "workers=0 is not a whole number of at least 1"),
        ({"rate": 0}, "rate=0 is no finite number above 0"),
        ({"temperature": -250}, "temperature=-250 is no finite number above -200 and below 500"),
        ({"temperature": 1e140}, "temperature=1e+140 is no finite number above -200 and below 500"),
        ({"fix": {"R": "2"}}, "fix['R']='2' is no finite number"),
        ({"fix": ["R"]}, "fix=['R'] is no mapping of names to numbers"),
        ({"fix": {"R": 10**400}}, "is no finite number"),
        ({"scale": {"i": float("nan")}}, "scale['i']=nan is no finite number"),
        ({"bounds": {"R": 5}}, "bounds['R']=5 is no pair of numbers, such as (0.4, 2.0)"),
        ({"bounds": {"R": (5, 1)}}, "bounds['R']=(5, 1) ends before it begins; give the lower end first"),
        ({"bounds": {"R": (1, float("inf"))}}, "bounds['R']=inf is no finite number"),
        ({"bounds": (1, 5)}, "bounds=(1, 5) is no mapping of names to pairs of numbers"),
        ({"window": "0.1:1"}, "window='0.1:1' is no pair of numbers, such as (0.4, 2.0)"),
        ({"starts": [{"R": "x"}]}, "starts['R']='x' is no finite number"),
        ({"loss": "hubert"}, "there is no loss 'hubert'; did you mean 'huber'? (linear, huber)"),
        ({"validate": "nowhere.csv"}, "nowhere.csv; give the path of a text file"),
    ],
    ids=str,
)
def test_values_are_checked_as_those_of_the_command_line_are(given, sentence, monkeypatch):
    monkeypatch.chdir(ROOT)
    with pytest.raises(estimator.InputError, match=re.escape(sentence)):
        estimator.estimate_parameters("examples/cml050_step.csv", **given)


def test_an_fmu_is_described_and_simulated():
    assert {v.name: v.unit for v in estimator.describe_fmu("dc_motor").variables}["R"] == "Ohm"
    times = np.arange(200) * 1e-3
    shown = estimator.simulate_fmu("dc_motor", times=times, inputs={"v": np.full(200, 6.0)}, parameters={"R": 3.0})
    assert set(shown) == {"i", "w", "angle"} and shown["w"].shape == (200,) and shown["w"][-1] > 50


@pytest.mark.parametrize(
    ("v", "shape"), [(12.0, "()"), ([12.0] * 4, "(4,)"), (np.full((200, 1), 12.0), "(200, 1)")], ids=str
)
def test_an_input_that_is_not_as_long_as_the_times_is_told(v, shape):
    """A shorter one was simulated: what lay behind it in memory was the rest of the voltage."""
    with pytest.raises(
        estimator.InputError, match=re.escape(f"input 'v' has shape {shape}; it should be as long as times, (200,)")
    ):
        estimator.simulate_fmu("dc_motor", times=np.arange(200) * 1e-3, inputs={"v": v})
    with pytest.raises(estimator.InputError, match="the input 'v': no array of numbers; give one float per sample"):
        estimator.simulate_fmu("dc_motor", times=np.arange(200) * 1e-3, inputs={"v": ["12 V"] * 200})


@pytest.mark.parametrize(
    ("times", "parameters", "sentence"),
    [
        ([], {}, "a simulation needs at least two times"),
        (None, {}, "a simulation needs at least two times"),
        ([[0, 1], [2, 3]], {}, "a simulation needs at least two times"),
        (["a", "b"], {}, "times: no array of numbers; give one float per sample"),
        ([0.0, np.nan, 0.2], {}, "the times of a simulation must increase in equal steps"),
        (np.arange(20) * 1e-3, {"R": "3"}, "R = '3' is no finite number"),
        (np.arange(20) * 1e-3, {"R": np.nan}, "R = nan is no finite number"),
        (np.arange(20) * 1e-3, {"R": -1.0}, "R = -1 is outside the range 1e-06 to 1e+06 that dc_motor.fmu allows"),
    ],
)
def test_what_no_simulation_takes_is_told(times, parameters, sentence):
    with pytest.raises(estimator.InputError, match=re.escape(sentence)):
        estimator.simulate_fmu("dc_motor", times=times, parameters=parameters)


@pytest.mark.parametrize("formats", [["matlab", "octave"], "csv"])
def test_a_format_that_there_is_not_is_told(formats, result, tmp_path):
    """Each was taken for the rebuilt FMU: of "csv" each letter."""
    with pytest.raises(estimator.InputError, match="there is no format '(octave|c)'.*matlab"):
        result.export(tmp_path / "out", formats=formats)
    assert not (tmp_path / "out").exists()


def test_a_result_shows_itself_as_text_and_in_a_notebook(result):
    assert repr(result).startswith("read cml050_step: v ← voltage [V] · i ← current [A] · w ← speed [rad/s]")
    assert "\n\nOK: Every free parameter is identified" in repr(result)
    made = Result.of(with_parameter(estimate(verdict="doubtful", reasons=("L <weak>",)), "R", nominal=3.0))
    fragment = made._repr_html_()
    text = " ".join(parsed(fragment).text)
    assert "Doubtful" in text and "L <weak>" in text and "3.1363" in text
    assert all(line.startswith(".fmu-estimator ") for line in made._repr_html_().split("style>")[1].split("\n")[1:-1])
    assert "http" not in fragment and "<script" not in fragment


def test_a_result_writes_itself(result, tmp_path):
    written = result.save(tmp_path / "out")
    assert {p.name for p in written} == {"result.json", "report.html", "parameters.ssv", "figure.png"}
    assert json.loads((tmp_path / "out" / "result.json").read_text())["seed"] == 1
    (path,) = result.export(tmp_path / "out", formats=["csv"])
    assert path.read_text().startswith("parameter,value")


def test_a_result_is_a_linear_system(result):
    model = result.state_space()
    assert model.A[0, 0] == -result.values["R"] / result.values["L"]


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("fix it with --fix R=VALUE, or measure it", 'fix it with fix={"R": VALUE}, or measure it'),
        ("say so with --column 'v=1 [Volt]' --column i=3", 'say so with columns={"v": "1 [Volt]", "i": "3"}'),
        ("--unit i=mA, or --unit i=A if not", 'units={"i": "mA"}, or units={"i": "A"} if not'),
        ("--supply 12 (volts), --supply b/255, or --supply", 'supply=12 (volts), supply="b/255", or supply'),
        ("--scale i=-1; --bounds R=0.1:5 (--rate HZ)", 'scale={"i": -1}; bounds={"R": (0.1, 5)} (rate=HZ)'),
        ("which: --motor left, --motor 2; with --per-turn", 'which: motor="left", motor="2"; with per_turn'),
        ("--tolerance default adds -- or not", "--tolerance default adds -- or not"),
    ],
)
def test_a_remedy_names_the_arguments_of_python(said, meant):
    assert in_python(said) == meant


def test_an_error_of_an_estimate_names_arguments_and_keeps_its_kind():
    table = {"time [s]": np.arange(99) / 1e3, "duty [%]": np.ones(99), "speed [rpm]": np.ones(99)}
    with pytest.raises(RecordingError, match=r"with supply=12 \(volts\)"):
        estimator.estimate_parameters(table)
