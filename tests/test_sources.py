"""What `estimate` may be given: several recordings, patterns, stdin; and what it says of anything else."""

import io
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import forked
import pytest
from test_cli import calls, fails  # noqa: F401 - a fixture
from test_report import check_contract

from estimator.cli import main
from estimator.commands.sources import case_of, expanded

pytestmark = pytest.mark.usefixtures("shared_workers")

ROOT = Path(__file__).parent.parent
RECORDING = ROOT / "examples" / "cml050_step.csv"


def test_recordings_on_both_sides_of_an_option_and_patterns_are_fitted_together(calls, capsys, tmp_path):  # noqa: F811
    for name in ("run_1.csv", "run_2.csv", "up.csv", "[odd].csv"):
        (tmp_path / name).touch()
    assert main(["estimate", "up.csv", "--seed", "4", "run_*.csv", "[odd].csv"]) == 0
    assert [path.name for path in calls.case.recordings] == ["up.csv", "run_1.csv", "run_2.csv", "[odd].csv"]
    assert all(path.is_absolute() for path in calls.case.recordings) and calls.case.search.seed == 4
    capsys.readouterr()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("up.csv up.csv", "up.csv is given twice; leave one out"),
        ("up.csv u*.csv runs/../up.csv", "up.csv is given twice; leave one out"),
        ("up.csv runs/../up.csv", "runs/../up.csv is given twice and as up.csv; leave one out"),
        ("no_*.csv", "no file matches 'no_*.csv'; give the names of recordings, or put the pattern right"),
        (
            "runs",
            "runs is a folder; fit its recordings together with fmu-estimator estimate 'runs/*.mat',"
            " or each by itself with fmu-estimator batch runs/*.mat",
        ),
        ("empty", "empty is a folder without recordings; give one with its name, such as empty/run.csv"),
        ("cases", "cases is a folder with case files; estimate each of them with fmu-estimator batch cases"),
        ("a.case.toml up.csv", "a.case.toml is a case file; give it alone; it names its own recordings"),
        (
            "a.case.toml b.case.toml",
            "a.case.toml is a case file; give it each by itself, with fmu-estimator batch",
        ),
        ("up.csv motor.toml", "motor.toml: the name of a case file ends in .case.toml; rename it"),
        ("-", "- stands for stdin, but nothing is piped into it; write fmu-estimator estimate - < run.csv"),
        ("- --save-case x.case.toml", "- stands for stdin, but nothing is piped into it"),
        ("up.csv --out x", "unrecognized arguments: --out; did you mean '-o'?"),
        ("up.csv --outptu=x", "unrecognized arguments: --outptu; did you mean '-o'?"),
        ("up.csv --ouput x", "unrecognized arguments: --ouput; did you mean '-o'?"),
    ],
)
def test_what_does_not_go_together_is_told(calls, capsys, monkeypatch, tmp_path, words, sentence):  # noqa: F811
    for folder in ("runs", "cases", "empty"):
        (tmp_path / folder).mkdir()
    for name in ("up.csv", "runs/a.mat", "runs/b.mat", "runs/notes.txt", "cases/m.case.toml"):
        (tmp_path / name).touch()
    monkeypatch.setattr(sys, "stdin", None)
    assert fails(capsys, "estimate", *words.split()).startswith(sentence)


@pytest.mark.parametrize("name", ["run.csv", "run.MAT", "motor.case.toml", "folder/run.parquet"])
def test_a_recording_without_a_command_suggests_estimate(capsys, name):
    said = fails(capsys, name)
    assert said == f"there is no command {name!r}; did you mean fmu-estimator estimate {name}?"


def test_stdin_is_a_file_as_long_as_it_is_needed(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(RECORDING.read_bytes())))
    with case_of(["-"]) as case:
        (path,) = case.recordings
        assert path.name == "stdin" and path.read_bytes() == RECORDING.read_bytes()
    assert not path.exists()
    assert expanded(["-", str(RECORDING)]) == ["-", str(RECORDING)]


def test_a_pipe_with_a_name_is_a_file_as_long_as_it_is_needed(tmp_path, capsys):
    """It was opened twice: `check run.fifo` waited without end, and of `check <(zcat run.csv.gz)` nothing was left."""
    pipe = tmp_path / "run.fifo"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as writers:
        writers.submit(pipe.write_bytes, RECORDING.read_bytes())
        with case_of([str(pipe)]) as case:
            (path,) = case.recordings
            assert path.name == "run.fifo" and path.read_bytes() == RECORDING.read_bytes()
        assert not path.exists()
        writers.submit(pipe.write_bytes, RECORDING.read_bytes())
        said = fails(capsys, "estimate", str(pipe), "--save-case", str(tmp_path / "x.case.toml"))
    assert said.endswith("run.fifo is none; save it to a file first")


@pytest.fixture(scope="module")
def once_and_twice():
    """Return what is found from stdin, and from stdin and the same recording again."""
    both = [
        forked.run("estimate", "-", *more, "--json", cwd=ROOT, given=RECORDING.read_bytes())
        for more in ([], [str(RECORDING)])
    ]
    assert [done.returncode for done in both] == [0, 0]
    return [check_contract(done.stdout) for done in both]


def test_of_one_recording_twice_and_stdin_there_is_an_estimate(once_and_twice):
    found, together = once_and_twice
    assert found["verdict"] == "ok"
    assert [r["recording"] for r in together["read"]] == ["stdin", "cml050_step"]
    for name in ("R", "K", "L", "J", "B"):
        p = found["parameters"][name]
        assert together["parameters"][name]["value"] == pytest.approx(p["value"], abs=0.1 * p["standard_error"])


def test_of_one_recording_twice_the_noise_counts_twice(once_and_twice):
    errors = [found["parameters"]["J"]["standard_error"] for found in once_and_twice]
    assert errors[1] == pytest.approx(errors[0] / 2**0.5, rel=0.1)


def test_recordings_of_one_name_are_told_apart_by_their_folders(tmp_path):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "step.csv").write_bytes(RECORDING.read_bytes())
    words = (str(tmp_path / "a" / "step.csv"), str(tmp_path / "b" / "step.csv"), "--json")
    notes = check_contract(forked.run("estimate", *words, cwd=ROOT).stdout)["notes"]
    assert [sum(note.startswith(f"{folder}/step.csv: step from") for note in notes) for folder in "ab"] == [1, 1]


def test_stdin_names_no_recording_for_a_case_file(tmp_path):
    done = forked.run("estimate", "-", "--save-case", str(tmp_path / "x.case.toml"), cwd=ROOT, given=b"time [s],v\n")
    assert done.returncode == 2 and not (tmp_path / "x.case.toml").exists()
    assert done.stderr.endswith("stdin is none; save it to a file first\n")


@pytest.mark.parametrize(
    "arguments",
    [
        ["estimate", str(RECORDING), "--json", "--quiet"],
        ["--help"],
        ["schema"],
        pytest.param(["inspect", "dc_motor"], marks=pytest.mark.full),
    ],
)
def test_a_full_disk_behind_stdout_is_one_sentence(arguments):
    with open("/dev/full", "w") as full:
        done = forked.run(*arguments, cwd=ROOT, stdout=full.fileno())
    told = "fmu-estimator: stdout cannot be written (No space left on device); send it elsewhere\n"
    assert (done.returncode, done.stderr) == (2, told)


def test_a_full_disk_behind_stdout_does_not_keep_the_files_from_being_written(tmp_path):
    with open("/dev/full", "w") as full:
        done = forked.run("estimate", str(RECORDING), "-o", str(tmp_path / "out"), cwd=ROOT, stdout=full.fileno())
    assert done.returncode == 2 and (tmp_path / "out" / "result.json").exists()


def test_an_estimate_that_cannot_be_written_is_printed_all_the_same(calls, capsys, monkeypatch):  # noqa: F811
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("estimator.output.os.replace", full)
    assert main(["estimate", "step.csv", "-o", "out", "--json"]) == 2
    out, err = capsys.readouterr()
    assert check_contract(out)["verdict"] == "ok"
    assert err.endswith("out/result.json: cannot be written (No space left on device); give another place\n")
    assert err.count("\n") == 1
