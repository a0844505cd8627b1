"""Small things that a new user meets: huge numbers, formulas in names, folders in use, installs without a compiler."""

import csv
import io
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from forked import Kept, run
from interrupts import taking_interrupts
from made_estimates import estimate
from test_report import check_contract

from estimator.batches.batch_table import csv_of
from estimator.cli import interrupt_again
from estimator.errors import InputError, RecordingError
from estimator.judging.verdict import _hidden
from estimator.output import OutputFolder
from estimator.recordings.reading import read_recording
from estimator.recordings.time_grid import sampling_clock
from estimator.results.handover import csv_table
from estimator.results.result import NotVisible
from estimator.results.spreadsheet_cells import harmless

pytestmark = pytest.mark.usefixtures("shared_workers")

ROOT = Path(__file__).parent.parent
RECORDING = ROOT / "examples" / "cml050_step.csv"


def with_cell(tmp_path: Path, column: int, value: str) -> Path:
    """Return the example with another value in line 12."""
    lines = RECORDING.read_text().splitlines()
    header = next(k for k, line in enumerate(lines) if line.startswith("time"))
    cells = lines[11].split(",")
    assert header < 11
    cells[column] = value
    lines[11] = ",".join(cells)
    (tmp_path / "run.csv").write_text("\n".join(lines) + "\n")
    return tmp_path / "run.csv"


@pytest.mark.parametrize("value", ["1e308", "-1e308", "1e12"])
def test_a_value_that_nothing_measures_is_one_sentence_and_json_stays_json(tmp_path, value):
    path = with_cell(tmp_path, 2, value)
    done = run("estimate", str(path), "--json", cwd=ROOT)
    assert (done.returncode, done.stdout) == (2, "")
    said = f"run.csv line 12: current is {float(value):g}, which nothing measures; leave the cell of a missing sample"
    assert said in done.stderr and done.stderr.count("\n") == 1


def test_a_huge_time_is_told_and_a_huge_value_that_is_not_used_harms_nobody(tmp_path):
    with pytest.raises(RecordingError, match=r"run.csv line 12: time is 1e\+308, which nothing measures"):
        read_recording(with_cell(tmp_path, 0, "1e308"))
    recording = read_recording(with_cell(tmp_path, 2, "1e308"))
    assert "speed" in recording.signals and "current" not in recording.signals


def test_a_name_that_a_spreadsheet_would_compute_is_written_as_text():
    attack = "=cmd|' /C calc'!A0"
    for text in (attack, "+1", "-1", "@x", "\t=1", "\r=1"):
        assert harmless(text) == f"'{text}"
    rows = [[attack, -1.5, -2, None, "motor 1"]]
    written = list(csv.reader(io.StringIO(csv_of([attack, "a", "b", "c", "d"], rows).decode(), newline="")))
    assert written == [[f"'{attack}", "a", "b", "c", "d"], [f"'{attack}", "-1.5", "-2", "", "motor 1"]]
    made = estimate()
    odd = type(made)(**{**vars(made), "parameters": {attack: made.parameters["R"]}})
    assert csv_table(odd).decode().splitlines()[1].startswith(f"'{attack},")


def test_a_folder_that_another_run_writes_to_is_told(tmp_path):
    with OutputFolder(tmp_path / "out") as first:
        script = f"from estimator.output import OutputFolder; OutputFolder({str(first.path)!r}).__enter__()"
        other = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
        assert other.stderr.endswith(
            f"another run is at work in {first.path}; wait for its end, or give -o another folder\n"
        )
        with pytest.raises(InputError, match="another run is at work"), OutputFolder(first.path):
            pass
        first.write({"result.json": b"{}"})
    with OutputFolder(tmp_path / "out") as again:
        again.write({"result.json": b"[]"})
    with pytest.raises(InputError, match="already holds other files"), OutputFolder(tmp_path / "out", own=["x"]):
        pass
    with OutputFolder(tmp_path / "out"):
        pass


def test_two_estimates_into_one_folder_at_once_give_one_result_and_one_sentence(tmp_path):
    command = ("estimate", str(RECORDING), "-o", str(tmp_path / "out"), "--json")
    both = [Kept(*command, cwd=ROOT) for _ in range(2)]
    ended = sorted((process.communicate(timeout=60), process.returncode) for process in both)
    (lost, status), (won, good) = ended
    if status == 0:
        pytest.skip("the first had ended before the second began")
    assert (status, good) == (2, 0) and b"another run is at work in" in lost[1] and lost[0] == b""
    found = check_contract(won[0].decode())
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == found


def test_a_clock_that_jitters_is_taken_as_printed_and_a_pause_of_it_is_named():
    times = np.arange(200) * 1e-3 + np.random.default_rng(1).uniform(-0.05e-3, 0.05e-3, 200)
    assert not sampling_clock(times, place=str).even
    times[120] += 0.4e-3
    clock = sampling_clock(times, place=str)
    assert np.array_equal(clock.time, times) and not clock.even
    times[120:] += 30.4e-3
    told = r"^line 122: time is 0\.03\d+ s after the row before, where 0\.00\d+ s is usual; save what was logged before"
    with pytest.raises(RecordingError, match=told):
        sampling_clock(times, place=lambda k: f"line {k + 2}")


def test_an_install_without_a_compiler_says_so_in_one_sentence(tmp_path):
    script = """
import sys
sys.path.insert(0, {root!r})
import fmu_build.compiler
from fmu_build.errors import BuildError
from fmu_build.install_hook import CustomBuildHook

def none(*_, **__):
    raise BuildError("there is no C compiler; install gcc")

fmu_build.compiler.compile_library = none
hook = CustomBuildHook({root!r}, {{}}, None, None, "", "wheel")
hook.initialize("standard", {{}})
"""
    pytest.importorskip("hatchling")
    done = subprocess.run(
        [sys.executable, "-c", script.format(root=str(ROOT))], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr == "fmu-estimator cannot be installed: there is no C compiler; install gcc\n"


def test_ctrl_c_in_a_callback_of_the_interpreter_is_not_lost(monkeypatch):
    class Gone:
        def __del__(self) -> None:
            raise KeyboardInterrupt

    monkeypatch.setattr(sys, "unraisablehook", interrupt_again)
    with taking_interrupts(), pytest.raises(KeyboardInterrupt):
        Gone()
        for _ in range(1000):
            time.sleep(0.01)  # it comes between two instructions


def test_an_effect_without_a_unit_is_told_without_a_gap():
    off = {"J": (-0.05, -13.0), "R": (0.041, 13.0)}
    told = _hidden([NotVisible("curve of i", 0.049, "", off), NotVisible("sag", 0.2, "Ohm", {"R": (0.06, 19.0)})])
    assert told == ["curve of i 0.049 (J -5 %, R +4.1 %)", "sag 0.2 Ohm (R +6 %)"]
