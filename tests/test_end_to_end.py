"""The commands as a user runs them: real processes, the real FMU, real files."""

import json
import os
import pty
import re
import select
import signal
import subprocess
import time
from pathlib import Path

import forked
import pytest
from fmpy.ssp.ssd import read_ssv
from test_report import check_contract

from estimator.recordings.reading import read_recording

pytestmark = pytest.mark.usefixtures("compiled_quickly")

MOTOR = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}  # the paper, Tables III and IV
SETTINGS = [word for name, value in MOTOR.items() for word in ("--set", f"{name}={value!r}")]


def run(*arguments: str, cwd: Path, status: int = 0) -> subprocess.CompletedProcess[str]:
    """Run a command to its end and check its exit status."""
    done = forked.run(*arguments, cwd=cwd)
    assert done.returncode == status, done.stderr
    return done


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """Return a folder with a noise-free recording of the motor, step.csv."""
    folder = tmp_path_factory.mktemp("bench")
    done = run("simulate", "dc_motor", *SETTINGS, "--voltage-step", "10.5@0.5", "-o", "step.csv", cwd=folder)
    assert done.stdout == done.stderr == ""
    return folder


def test_what_simulate_writes_estimate_reads_and_finds_the_motor_again(bench):
    done = run("estimate", "step.csv", "--json", cwd=bench)
    found = check_contract(done.stdout)
    assert done.stderr == "" and found["verdict"] == "ok"
    for name, value in MOTOR.items():
        assert found["parameters"][name]["value"] == pytest.approx(value, rel=1e-8)
    assert sum(found["simulations_by_phase"].values()) == found["simulations"]
    assert found["fmu"]["name"] == "dc_motor" and found["failed_simulations"] == 0
    assert set(os.listdir(bench)) == {"step.csv"}, "without -o nothing is written"


def test_the_result_does_not_depend_on_the_number_of_workers(bench):
    found = []
    for workers in ("1", "2"):
        result = json.loads(run("estimate", "step.csv", "--json", "--workers", workers, cwd=bench).stdout)
        assert result.pop("workers") <= int(workers)
        result.pop("seconds")
        found.append(result)
    assert found[0] == found[1]


def test_a_fixed_parameter_stays_and_bounds_hold(tmp_path):
    short = ("--voltage-step", "10.5@0.1", "--stop", "0.4")  # a bound that is wrong takes long to explain
    run("simulate", "dc_motor", *SETTINGS, *short, "-o", "short.csv", cwd=tmp_path)
    done = run("estimate", "short.csv", "--json", "--fix", "L=0.01307", "--bounds", "R=3.2:5", cwd=tmp_path)
    found = check_contract(done.stdout)["parameters"]
    assert found["L"]["value"] == 0.01307 and not found["L"]["free"]
    assert (found["R"]["lower"], found["R"]["upper"]) == (3.2, 5.0) and 3.2 <= found["R"]["value"] <= 5.0


def test_the_paper_motor_demo_gives_all_files_and_shows_nominal_values(tmp_path):
    done = run("demo", cwd=tmp_path)
    folder = tmp_path / "fmu-estimator-demo"
    assert done.stderr == ""
    assert {p.name for p in folder.iterdir()} == {
        "recording.csv", "result.json", "report.html", "parameters.ssv", "figure.png",
    }  # fmt: skip
    found = check_contract((folder / "result.json").read_text())
    for name, value in MOTOR.items():
        parameter = found["parameters"][name]
        # 4.5 standard errors: 7e-6 for each of five
        assert abs(parameter["value"] - value) < 4.5 * parameter["standard_error"]
        assert re.search(rf"^{name} .* {parameter['unit']} .* [-+]\d.* %", done.stdout, re.MULTILINE)
    written = {p.name: (float(p.value), p.unit) for p in read_ssv(str(folder / "parameters.ssv")).parameters}
    assert written == {n: (p["value"], p["unit"]) for n, p in found["parameters"].items()}
    page = (folder / "report.html").read_text()
    assert page.count('<svg class="chart"') == 4 and page.count("nominal") >= 5 and not re.search("https?:", page)
    assert len(read_recording(folder / "recording.csv").time) == 2801


def test_a_voltage_that_never_changes_is_refused_with_status_1(tmp_path):
    rows = "\n".join(f"{k / 1000},0,0,0" for k in range(500))
    (tmp_path / "still.csv").write_text(f"time [s],voltage [V],current [A],speed [rpm]\n{rows}\n")
    done = run("estimate", "still.csv", "--json", "-o", "out", cwd=tmp_path, status=1)
    found = check_contract(done.stdout)
    assert found["verdict"] == "refused" and "voltage" in found["reasons"][0]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"result.json", "report.html", "figure.png"}


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (None, "bad.csv"),
        ("", "bad.csv"),
        ("time [s],voltage [V],current [A],speed [rad/s]\n", "bad.csv"),
        ("time [s],current [A],speed [rad/s]\n" + "".join(f"{k},1,2\n" for k in range(20)), "voltage"),
        (
            "time [s],voltage [V],current [A],speed [m]\n" + "".join(f"{k},1,2,3\n" for k in range(20)),
            "'m' is no unit of angular speed",
        ),
        (
            "time [s],voltage [V],current [A],speed [rad/s]\n"
            + "".join(f"{k},1,{'x' if k == 7 else 2},3\n" for k in range(20)),
            "bad.csv line 9: current is not a number",
        ),
    ],
)
def test_a_bad_recording_is_one_sentence_and_status_2(tmp_path, text, sentence):
    if text is not None:
        (tmp_path / "bad.csv").write_text(text)
    done = run("estimate", "bad.csv", "--json", "-o", "out", cwd=tmp_path, status=2)
    assert done.stdout == "" and done.stderr.count("\n") == 1
    assert sentence in done.stderr
    assert not (tmp_path / "out").exists()


def test_an_fmu_is_built_inspected_and_used_as_a_file(tmp_path, bench):
    assert run("build", "dc_motor", "-o", "mine.fmu", cwd=tmp_path).stdout == "mine.fmu\n"
    found = json.loads(run("inspect", "mine.fmu", "--json", cwd=tmp_path).stdout)
    assert [p["name"] for p in found["parameters"]] == list(MOTOR)
    assert found["problems"] == [] and found["warnings"] == []
    done = run("estimate", str(bench / "step.csv"), "--fmu", "mine.fmu", "--json", cwd=tmp_path)
    assert check_contract(done.stdout)["fmu"]["path"] == str(tmp_path / "mine.fmu")


def on_terminal(*arguments: str, cwd: Path, interrupt_at: str | None = None) -> tuple[str, str, int]:
    """Run a command with stderr on a terminal; return stdout, what the terminal got, and the exit status."""
    master, slave = pty.openpty()
    process = forked.Kept(*arguments, cwd=cwd, stderr=slave)
    os.close(slave)
    got = ""
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if select.select([master], [], [], 0.1)[0]:
            try:
                got += os.read(master, 10_000).decode()
            except OSError:  # the other end is closed
                break
        if interrupt_at is not None and interrupt_at in got:
            process.send_signal(signal.SIGINT)
            interrupt_at = None
    out, _ = process.communicate(timeout=60)
    os.close(master)
    return out.decode(), got, process.returncode


def test_a_terminal_shows_progress_and_then_nothing_of_it(bench):
    out, got, status = on_terminal("estimate", "step.csv", "--json", cwd=bench)
    assert status == 0 and check_contract(out)
    assert re.search(r"\r(probe|search|polish)  \d+ .*simulations", got)
    assert got.split("\r")[-2].strip() == "" and got.endswith("\r")


def test_ctrl_c_ends_with_the_best_so_far_and_status_130(bench):
    out, got, status = on_terminal("estimate", "step.csv", "--method", "paper", cwd=bench, interrupt_at="cost")
    assert (out, status) == ("", 130)
    last = got.split("\r")
    assert re.search(r"fmu-estimator: interrupted; the best so far: R=\S+ K=\S+ L=\S+ J=\S+ B=\S+", got), last
    assert "Traceback" not in got
