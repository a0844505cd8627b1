"""Batches: nothing lost, nothing twice, the same table however often they are interrupted (batch*.py, bench*.py)."""

import csv
import dataclasses
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import forked
import numpy as np
import psutil
import pytest
from interrupts import takes_interrupts

from estimator.batches import worker_pool
from estimator.batches.batch import BatchResult, gather, last_line, run_batch, with_reports
from estimator.batches.batch_folder import BatchFolder, DiskError, folder_name
from estimator.batches.batch_table import flat, table_files
from estimator.batches.case_worker import Outcome, Task, failed
from estimator.cases.case import Case
from estimator.cli import main
from estimator.errors import InputError

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"
TABLES = ("results.csv", "results.jsonl", "statistics.csv", "outliers.csv")
SHORT = "[search]\nnests = 4\niterations = 2\n"


def line_of(folder, motors):
    """Write recordings of `motors` motors, each with its own noise, and a case file for them all."""
    folder.mkdir(exist_ok=True)
    lines = EXAMPLE.read_text().splitlines()
    head = [k for k, line in enumerate(lines) if re.match(r"[-\d]", line)][0]
    columns = np.array([[float(cell) for cell in line.split(",")] for line in lines[head:]])
    for k in range(motors):
        noisy = columns[300:1300].copy()
        noisy[:, 2:] += np.random.default_rng(k).standard_normal((len(noisy), noisy.shape[1] - 2)) * [0.02, 1.0]
        rows = [",".join(f"{x:.6g}" for x in row) for row in noisy]
        (folder / f"motor_{k:03}.csv").write_text("\n".join([lines[head - 1], *rows]) + "\n")
    (folder / "line.case.toml").write_text(SHORT + '[[recording]]\nfile = "motor_*.csv"\n')
    return folder / "line.case.toml"


def tables_of(folder):
    return [(folder / name).read_bytes() for name in TABLES]


# Without any FMU: outcomes made up


def made_up(tasks):
    for task in tasks:
        row = failed(task, "made up").row
        row |= {"verdict": "ok", "reasons": [], "simulations": len(task.name)}
        row["parameters"] = {
            "R": {"value": 1 / 3, "standard_error": 0.1, "unit": "Ohm", "at_bound": None, "status": "ok"}
        }
        yield task, Outcome(row, {"result.json": b"{}"}, {"seconds": time.monotonic()})


@pytest.fixture
def cases(tmp_path):
    folder = tmp_path / "line"
    folder.mkdir()
    for k in range(5):
        (folder / f"m{k}.csv").write_text(str(k))
    (folder / "line.case.toml").write_text('[[recording]]\nfile = "m*.csv"\n')
    return gather([folder / "line.case.toml"])


class Stopped(Exception):
    pass


def stopping_after(count):
    def run(tasks):
        for k, answer in enumerate(made_up(tasks)):
            if k == count:
                raise Stopped
            yield answer

    return run


def test_a_batch_that_is_interrupted_before_its_first_case_names_no_folder(tmp_path, monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("estimator.batches.batch.run_batch", interrupted)
    (tmp_path / "run.csv").write_text("")
    for folder, said in (("none", "no case was begun"), (".", "what is done is in ., go on with --resume")):
        monkeypatch.chdir(tmp_path)
        assert main(["batch", "run.csv", "-o", folder]) == 130
        assert capsys.readouterr().err == f"fmu-estimator: interrupted; {said}\n"


@pytest.mark.parametrize("done", [0, 1, 4])
def test_an_interrupted_batch_goes_on_with_what_is_missing_and_ends_in_the_same_table(done, cases, tmp_path):
    run_batch(cases, tmp_path / "whole", made_up)
    with pytest.raises(Stopped):
        run_batch(cases, tmp_path / "parts", stopping_after(done))
    ran = []

    def run(tasks):
        for answer in made_up(tasks):
            ran.append(answer[0].name)
            yield answer

    result = run_batch(cases, tmp_path / "parts", run, resume=True)
    assert (result.kept, len(ran)) == (done, 5 - done)
    assert tables_of(tmp_path / "parts") == tables_of(tmp_path / "whole")


def test_the_table_does_not_depend_on_the_order_in_which_cases_end(cases, tmp_path):
    run_batch(cases, tmp_path / "a", made_up)
    run_batch(cases, tmp_path / "b", lambda tasks: reversed(list(made_up(tasks))))
    assert tables_of(tmp_path / "a") == tables_of(tmp_path / "b")
    names = [row["case"] for row in csv.DictReader((tmp_path / "a" / "results.csv").read_text().splitlines())]
    assert names == [f"line[m{k}]" for k in range(5)]


def test_times_and_hosts_are_in_a_table_of_their_own(cases, tmp_path):
    run_batch(cases, tmp_path / "a", made_up)
    assert (tmp_path / "a" / "timings.csv").read_text().startswith("case,seconds,search_seconds,files_seconds,host\n")
    assert not re.search("seconds|host", (tmp_path / "a" / "results.jsonl").read_text())
    (first, *_) = [json.loads(line) for line in (tmp_path / "a" / "results.jsonl").read_text().splitlines()]
    assert first["parameters"]["R"]["value"] == 1 / 3


def test_a_report_is_made_on_demand_of_one_case_and_stays(cases, tmp_path):
    ran = []

    def run(tasks):
        for task, outcome in made_up(tasks):
            ran.append((task.name, task.report))
            files = {**outcome.files, **({"report.html": b"x"} if task.report else {})}
            yield task, dataclasses.replace(outcome, files=files)

    run_batch(cases, tmp_path / "out", run, command="fmu-estimator batch line.case.toml")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "fmu-estimator batch line.case.toml --resume --report-of CASE" in page
    ran.clear()
    wanted = with_reports(cases, ["line[m3]"])
    for some in (wanted, wanted, cases):
        run_batch(some, tmp_path / "out", run, resume=True)
    assert ran == [("line[m3]", True)]
    page = (tmp_path / "out" / "index.html").read_text()
    assert 'href="cases/line%5Bm3%5D/report.html"' in page and 'href="cases/line%5Bm2%5D/result.json"' in page
    with pytest.raises(InputError, match="there is no case 'line.m9.' to report of"):
        with_reports(cases, ["line[m9]"])


def test_a_table_of_starts_that_has_changed_is_run_again_and_one_that_has_moved_is_not(tmp_path):
    """What the table held did not count, and where it lay did."""
    (tmp_path / "line").mkdir()
    (tmp_path / "line" / "run.csv").write_text("time,voltage,current,speed\n")
    (tmp_path / "line" / "starts.csv").write_text("R,K\n3,0.05\n")
    case = tmp_path / "line" / "motor.case.toml"
    case.write_text('[[recording]]\nfile = "run.csv"\n[search]\nstarts = "starts.csv"\n')
    run_batch(gather([case]), tmp_path / "out", made_up)
    (tmp_path / "line").rename(tmp_path / "moved")
    moved = gather([tmp_path / "moved" / "motor.case.toml"])
    assert run_batch(moved, tmp_path / "out", made_up, resume=True).kept == 1
    (tmp_path / "moved" / "starts.csv").write_text("R,K\n4,0.05\n")
    assert run_batch(moved, tmp_path / "out", made_up, resume=True).kept == 0


def test_what_has_changed_since_is_run_again(cases, tmp_path):
    folder = tmp_path / "line"
    run_batch(cases, tmp_path / "out", made_up)
    (folder / "m2.csv").write_text("other")
    assert run_batch(cases, tmp_path / "out", made_up, resume=True).kept == 4
    (folder / "line.case.toml").write_text('[search]\nseed = 2\n[[recording]]\nfile = "m*.csv"\n')
    assert run_batch(gather([folder]), tmp_path / "out", made_up, resume=True).kept == 0
    shutil.copytree(folder, tmp_path / "moved")  # where it lies does not matter
    assert run_batch(gather([tmp_path / "moved"]), tmp_path / "out", made_up, resume=True).kept == 5


def test_half_an_outcome_is_none(cases, tmp_path):
    run_batch(cases, tmp_path / "out", made_up)
    outcome = tmp_path / "out" / "cases" / "line[m1]" / "outcome.json"
    outcome.write_bytes(outcome.read_bytes()[:-20])
    assert run_batch(cases, tmp_path / "out", made_up, resume=True).kept == 4


def test_a_failure_that_may_pass_is_tried_again(cases, tmp_path):
    def run(tasks):
        for task in tasks:
            yield task, failed(task, "killed", final=False)

    assert run_batch(cases, tmp_path / "out", run).verdicts == {"failed": 5}
    result = run_batch(cases, tmp_path / "out", made_up, resume=True)
    assert (result.kept, result.verdicts) == (0, {"ok": 5})


@pytest.mark.parametrize(
    ("before", "message"),
    [
        (
            lambda p, c: run_batch(c, p, made_up),
            r"already holds a batch; go on with --resume, or give -o another folder$",
        ),
        (lambda p, c: p.write_text(""), r"is a file, not a folder; give -o another name$"),
        (
            lambda p, c: BatchFolder(p, resume=False),
            r"^another batch is at work in .*; wait for it, or give -o another",
        ),
    ],
)
def test_a_folder_that_cannot_be_used_is_said(before, message, cases, tmp_path):
    held = before(tmp_path / "out", cases)
    with pytest.raises(InputError, match=message):
        run_batch(cases, tmp_path / "out", made_up)
    if isinstance(held, BatchFolder):
        held.close()


def test_a_folder_that_cannot_be_written_is_said(cases):
    with pytest.raises(InputError, match=r"^/proc/out: cannot write there \(.*\); give -o a folder of yours$"):
        run_batch(cases, Path("/proc/out"), made_up)


def test_a_case_file_with_a_mistake_does_not_stop_the_others(cases, tmp_path):
    (tmp_path / "line" / "bad.case.toml").write_text('[fmu]\npaht = 1\n[[recording]]\nfile = "m0.csv"\n')
    both = gather([tmp_path / "line"])
    result = run_batch(both, tmp_path / "out", made_up)
    assert result.verdicts == {"ok": 5, "failed": 1}
    assert "bad.case.toml line 2: there is no key 'paht'" in result.rows[0]["reasons"][0]
    table = tmp_path / "out" / "results.csv"
    assert last_line(result, table=table) == f"6 cases: 5 ok, 1 failed; {table}"
    assert last_line(BatchResult(result.rows, 2), table=table).startswith("6 cases (2 of them from before): ")


def test_one_case_is_no_plural():
    row = {"verdict": "ok", "checks": {}}
    assert last_line(BatchResult((row,)), table=Path("t")) == "1 case: 1 ok; t"


def test_the_last_line_counts_expectations_that_are_not_met(cases):
    rows = [outcome.row for _, outcome in made_up(cases.tasks[:2])]
    rows[0]["checks"] = {"R": "pass", "K": "fail"}
    assert last_line(BatchResult(tuple(rows)), table=Path("t")) == "2 cases: 2 ok; expectations: 1 met, 1 not met; t"
    rows[1]["checks"] = {"R": "undecided"}
    assert "; expectations: 1 met, 1 not met, 1 undecided; t" in last_line(BatchResult(tuple(rows)), table=Path("t"))


def test_case_files_of_one_name_are_told_apart(tmp_path):
    for day in ("mon", "tue"):
        (tmp_path / day).mkdir()
        (tmp_path / day / "run.csv").write_text("")
        (tmp_path / day / "line.case.toml").write_text('[[recording]]\nfile = "run.csv"\n')
    names = [task.name for task in gather([tmp_path]).tasks]
    assert names == ["mon/line.case.toml", "tue/line.case.toml"]
    assert len({folder_name(name) for name in names}) == 2
    assert [task.name for task in gather([tmp_path / "mon" / "run.csv"]).tasks] == ["run"]


def test_folders_of_cases_are_names_everywhere():
    assert folder_name("line[m1]") == "line[m1]"
    names = ["a/b", "a:b", "a b", "ä", "x" * 300, "x" * 301, ".."]
    made = {folder_name(name) for name in names}
    assert len(made) == len(names)
    assert all(re.fullmatch(r"[\w\[\]-]{1,140}", name, re.ASCII) for name in made)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("none.case.toml", r"^there is no case .*none\.case\.toml; give case files, folders of them, or recordings$"),
        ("empty", r"^there is no \*\.case\.toml in .*empty; give case files, or a folder of them$"),
        ("a.toml", r"a\.toml is no case; give files \*\.case\.toml, folders of them, or recordings$"),
    ],
)
def test_a_path_that_is_no_case_is_said(source, message, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.toml").write_text("")
    with pytest.raises(InputError, match=message):
        gather([tmp_path / source])


def test_a_flat_table_has_no_column_twice(cases):
    rows = [outcome.row for _, outcome in made_up(cases.tasks)]
    rows[0]["nameplate"] = {"R": {"value": 3.0, "standard_error": None, "unit": "Ohm"}}
    columns, cells = flat(rows)
    assert len(set(columns)) == len(columns)
    assert all(len(row) == len(columns) for row in cells)


def test_parquet_says_what_csv_says(cases):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    import pyarrow

    rows = [outcome.row for _, outcome in made_up(cases.tasks)]
    files = table_files(rows, {}, parquet=True)
    table = parquet.read_table(pyarrow.BufferReader(files["results.parquet"]))
    lines = list(csv.DictReader(files["results.csv"].decode().splitlines()))
    assert table.column_names == list(lines[0])
    assert table["R [Ohm]"].to_pylist() == [float(line["R [Ohm]"]) for line in lines]


def test_parquet_without_its_extra_is_said_before_any_time_is_spent(cases, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        InputError, match=r"--parquet needs pyarrow; install it with: pip install 'fmu-estimator\[parquet"
    ):
        run_batch(cases, tmp_path / "out", made_up, parquet=True)
    assert not (tmp_path / "out").exists()


# A disk that fills up


def test_a_full_disk_is_one_sentence_no_half_file_and_a_batch_that_goes_on(cases, tmp_path, monkeypatch):
    run_batch(cases, tmp_path / "whole", made_up)
    real = os.fsync
    left = [3]

    def full(descriptor):
        left[0] -= 1
        if left[0] < 0:
            raise OSError(28, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(
            DiskError, match=r"out: cannot be written \(No space left on device\); make room, then go on wi"
        ):
            run_batch(cases, tmp_path / "out", made_up)
    assert not (tmp_path / "out" / "results.csv").exists()
    kept = list((tmp_path / "out" / "cases").iterdir())
    assert [path.name for path in kept] == ["line[m0]"]
    assert run_batch(cases, tmp_path / "out", made_up, resume=True).kept == 1
    assert tables_of(tmp_path / "out") == tables_of(tmp_path / "whole")


@pytest.mark.skipif(os.name == "nt" or getattr(os, "geteuid", lambda: 1)() != 0, reason="mounting a tmpfs needs root")
def test_a_small_disk_that_is_really_full(cases, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("a tmpfs cannot be mounted here")
    try:

        def large(tasks):
            for task, outcome in made_up(tasks):
                yield task, Outcome(outcome.row, {"result.json": b"x" * 15_000}, outcome.timing)

        with pytest.raises(DiskError, match=r"\(No space left on device\); make room"):
            run_batch(cases, disk / "out", large)
        kept = [path.name for path in (disk / "out" / "cases").iterdir()]
        assert kept and all(name.startswith("line[m") for name in kept)
        for path in (disk / "out" / "cases").iterdir():
            assert (path / "result.json").stat().st_size == 15_000
            json.loads((path / "outcome.json").read_text())
        subprocess.run(["mount", "-o", "remount,size=1m", disk], check=True)
        assert run_batch(cases, disk / "out", large, resume=True).kept == len(kept)
        run_batch(cases, tmp_path / "whole", large)
        assert tables_of(disk / "out") == tables_of(tmp_path / "whole")
    finally:
        subprocess.run(["umount", disk], check=True)


# With processes


def command(folder, *arguments):
    return ["batch", "line.case.toml", "-o", str(folder), *arguments]


@pytest.mark.smoke
def test_the_command_line_end_to_end(tmp_path, capsys, monkeypatch):
    case = line_of(tmp_path / "line", 2)
    (case.parent / "motor_bad.csv").write_text("time [s],voltage [V]\n0,1\n")
    monkeypatch.chdir(tmp_path)
    assert main(["batch", str(case), "-o", "out"]) == 1
    said = capsys.readouterr()
    assert said.out.startswith("quantity ")
    assert said.out.splitlines()[-1].startswith("3 cases: ") and said.out.endswith(
        f" 1 failed; {Path('out/results.csv')}\n"
    )
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert float(rows[0]["K [V.s/rad]"]) == pytest.approx(0.0488, rel=0.02)
    assert rows[2]["reasons"].startswith("motor_bad.csv")
    assert json.loads((tmp_path / "out" / "cases" / "line[motor_000]" / "result.json").read_text())["parameters"]
    (case.parent / "motor_bad.csv").unlink()
    before = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert main(["batch", str(case), "-o", "out", "--resume"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("2 cases (2 of them from before): ")
    assert (tmp_path / "out" / "results.csv").read_text().splitlines() == before[:-1]
    assert main(["batch", str(case), "-o", "out"]) == 2
    assert main(["batch", "none.case.toml"]) == 2
    assert main(["batch", str(case), "-o", "/proc/out"]) == 2


def killed_and_resumed(folder, out, *, kills, longest, rng):
    """Run the batch, kill it -9 at random moments, go on, and return how often it was killed while it ran."""
    hits = 0
    for _ in range(kills):
        process = forked.Kept(*command(out), "--resume", cwd=folder)
        try:
            process.wait(timeout=rng.uniform(0.2, longest))
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            hits += 1
    return hits


def finished(folder, out):
    done = forked.run(*command(out), "--resume", cwd=folder)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("motors", "kills", "longest"), [(2, 2, 2.0), pytest.param(300, 20, 8.0, marks=pytest.mark.full)]
)
def test_a_batch_killed_at_random_moments_ends_in_the_same_table(motors, kills, longest, tmp_path):
    line_of(tmp_path / "line", motors)
    finished(tmp_path / "line", tmp_path / "whole")
    killed_and_resumed(
        tmp_path / "line", tmp_path / "killed", kills=kills, longest=longest, rng=np.random.default_rng(6)
    )
    finished(tmp_path / "line", tmp_path / "killed")
    assert tables_of(tmp_path / "killed") == tables_of(tmp_path / "whole")
    assert not list((tmp_path / "killed" / "cases").glob(".*"))


FRAGILE = """
import os, signal, sys
from estimator.batches import case_worker
def run(self, task):
    if task.name == "dies" or (task.name == "dies once" and not os.path.exists(sys.argv[-1] + "/died")):
        if task.name == "dies once": open(sys.argv[-1] + "/died", "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return case_worker.failed(task, task.name)
case_worker.CaseWorker.run = run
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, 40])
def test_a_process_that_dies_takes_nobody_along(number, tmp_path, monkeypatch):
    """Of a real-time signal, which has no name, the whole batch ended."""
    real = subprocess.Popen
    fault = FRAGILE.replace("signal.SIGKILL", str(int(number)))

    def fragile(arguments, **options):
        place = "from estimator.batches.case_worker"
        code = arguments[-1].replace(place, f"exec({fault!r}); {place}")
        return real([arguments[0], "-c", code, str(tmp_path)], **options)

    monkeypatch.setattr(worker_pool.subprocess, "Popen", fragile)
    tasks = [Task(name, Case()) for name in ("a", "dies", "b", "dies once", "c")]
    outcomes = {task.name: outcome for task, outcome in worker_pool.run_here(tasks, processes=2)}
    assert {name: outcome.row["reasons"][0] for name, outcome in outcomes.items()} == {
        "a": "a",
        "b": "b",
        "c": "c",
        "dies once": "dies once",
        "dies": f"the process that estimated it ended 2 times: {'signal 40' if number == 40 else 'SIGKILL'}",
    }
    assert not outcomes["dies"].final


def test_no_process_is_left_behind_when_the_batch_is_left(tmp_path):
    tasks = iter([Task(str(k), Case()) for k in range(1000)])
    running = worker_pool.run_here(tasks, processes=2)
    next(running)
    running.close()
    assert len(list(tasks)) > 500, "no more are begun, however late the machine comes to close it"


def test_a_mistake_where_tasks_come_from_ends_the_batch():
    def tasks():
        yield Task("a", Case())
        raise OSError("gone")

    with pytest.raises(OSError, match="gone"):
        list(worker_pool.run_here(tasks(), processes=1))


@pytest.mark.parametrize(
    ("how", "status"), [pytest.param(signal.SIGINT, 130, marks=pytest.mark.full), (signal.SIGKILL, -9)]
)
def test_an_end_from_outside_leaves_no_process_behind(how, status, tmp_path):
    line_of(tmp_path / "line", 40)
    process = subprocess.Popen(
        [sys.executable, "-m", "estimator", *command(tmp_path / "out")],
        cwd=tmp_path / "line",
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        preexec_fn=takes_interrupts,
    )
    while not list((tmp_path / "out").glob("cases/line*")):
        assert process.poll() is None
        time.sleep(0.02)
    children = psutil.Process(process.pid).children(recursive=True)
    assert len(children) >= 2  # benches, and the processes of their FMUs
    process.send_signal(how)
    _, said = process.communicate(timeout=30)
    assert process.returncode == status
    if how == signal.SIGINT:
        assert b"interrupted; what is done is in " in said
        assert (tmp_path / "out" / "results.csv").read_text().count("\n") > 1
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not alive
