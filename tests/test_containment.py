"""Whatever an FMU does, it costs a candidate, never the run. Every fault is compiled into an FMU and really happens."""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from faulty import faulty_fmu
from interrupts import takes_interrupts
from motors import CML050, NAMES, step_recording, write_recording
from test_stepper import NOMINAL, experiment, noisy_voltage

from estimator.cli import main
from estimator.errors import FmuError, SimulationError
from estimator.estimating.estimate import estimate_recordings
from estimator.fmus import run_folder
from estimator.fmus.fmu import describe
from estimator.fmus.job import Job
from estimator.fmus.probe import probe
from estimator.fmus.run_folder import PREFIX, RunFolder, remove_leftovers, try_lock
from estimator.fmus.workers import Workers
from estimator.stepping import layout
from estimator.stepping.folder import LOCK, remove

# In the middle of a simulation, only for candidates with a large L (value reference 4).
MARK = 'for (size_t k = 0; k < n; k++) if (references[k] == 4) setenv("BAD", values[k] > 0.02 ? "1" : "0", 1);'
IF_BAD = 'if (time > 0.1 && getenv("BAD") && getenv("BAD")[0] == \'1\')'

GOOD, BAD = NOMINAL, NOMINAL * [1, 1, 10, 1, 1]


def job_of(fmu, *, reinstantiate=False):
    description = describe(fmu)

    def references(names):
        return tuple(description.variable(n).value_reference for n in names)

    measured = np.ones((300, 2))
    return Job(
        description=description,
        parameter_references=references("RKLJB"),
        input_references=references("v"),
        output_references=references("iw"),
        sensors=(layout.IDENTITY, layout.IDENTITY),
        experiments=(experiment(noisy_voltage(), measured),),
        reinstantiate=reinstantiate,
    )


def run(fmu, candidates, *, time_limit=60.0, count=1, memory_limit=1 << 30, **job):
    """Return the batch, the crew's failures, and the pids before and after."""
    with Workers(count, time_limit=time_limit, memory_limit=memory_limit) as crew:
        crew.load(job_of(fmu, **job))
        before = crew.pool.pids
        batch = crew.run(np.array(candidates).reshape(len(candidates), 1, 5))
        return batch, crew.failures, before, crew.pool.pids


@pytest.fixture(scope="module")
def good_cost():
    batch, *_ = run("dc_motor", [GOOD])
    return batch.costs[0]


# A candidate that takes its process down


@pytest.mark.parametrize(
    ("death", "reason"),
    [
        pytest.param("raise(SIGSEGV);", "the FMU crashed (SIGSEGV)", id="segfault", marks=pytest.mark.full),
        pytest.param("*(volatile int *)8 = 1;", "the FMU crashed (SIGSEGV)", id="bad pointer"),
        pytest.param("abort();", "the FMU crashed (SIGABRT)", id="abort", marks=pytest.mark.full),
        pytest.param("exit(0);", "the FMU ended its process (exit status 0)", id="exit"),
        pytest.param("_Exit(3);", "the FMU ended its process (exit status 3)", id="_Exit", marks=pytest.mark.full),
    ],
)
@pytest.mark.usefixtures("started_workers")
def test_a_candidate_that_ends_the_process_is_replaced_and_counted(tmp_path, good_cost, death, reason):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} {{ {death} }}")
    batch, failures, before, after = run(fmu, [GOOD, BAD, GOOD])
    assert batch.failed.tolist() == [False, True, False]
    assert batch.costs.tolist() == [good_cost, np.inf, good_cost]
    assert failures[0].reason == reason
    assert failures[0].values == tuple(BAD)
    assert before != after


def test_a_reference_that_ends_its_process_is_an_error_and_the_next_candidate_is_simulated(tmp_path, good_cost):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} {{ abort(); }}")
    with Workers(1) as crew:
        crew.load(job_of(fmu))
        with pytest.raises(SimulationError, match="the FMU crashed"):
            crew.reference(BAD)
        assert crew.run(GOOD.reshape(1, 1, 5)).costs.tolist() == [good_cost]


def test_an_endless_step_is_ended_by_the_time_limit(tmp_path, good_cost):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} for (;;) {{}}")
    started = time.monotonic()
    batch, failures, *_ = run(fmu, [GOOD, BAD, GOOD], time_limit=1.0)
    assert time.monotonic() - started < 20
    assert batch.costs.tolist() == [good_cost, np.inf, good_cost]
    assert failures[0].reason == "the FMU exceeded the time limit of 1 s"


def test_an_endless_instantiation_is_ended_by_the_time_limit(tmp_path):
    fmu = faulty_fmu(tmp_path, Instantiate="for (;;) {}")
    batch, failures, *_ = run(fmu, [GOOD], time_limit=1.0)
    assert batch.failed.all()
    assert failures[0].reason == "the FMU exceeded the time limit of 1 s"


# Answers that are no answers


@pytest.mark.parametrize("status", ["Discard", "Error", "Fatal"])
def test_a_step_that_fails_costs_its_candidate_only(tmp_path, good_cost, status):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} return fmi2{status};")
    batch, failures, before, after = run(fmu, [GOOD, BAD, GOOD])
    assert batch.costs.tolist() == [good_cost, np.inf, good_cost]
    assert failures[0].reason == f"doStep returned {status}"
    assert before == after


@pytest.mark.parametrize(("status", "told"), [("-1", 255), ("77", 77), ("300", 44)])
def test_a_status_that_fmi_does_not_know_costs_its_candidate_only(tmp_path, good_cost, status, told):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} return (fmi2Status) {status};")
    batch, failures, *_ = run(fmu, [GOOD, BAD, GOOD])
    assert batch.costs.tolist() == [good_cost, np.inf, good_cost]
    assert [f.reason for f in failures] == [f"doStep returned the status {told}, which FMI does not know"]


def test_a_status_that_fmi_does_not_know_is_told_by_the_probe(tmp_path):
    found = probe(describe(faulty_fmu(tmp_path, DoStep="return (fmi2Status) 77;")), thorough=False)
    assert found.problem.startswith(
        "it does not run: doStep returned the status 77, which FMI does not know at t = 0 s"
    )


def test_the_fmus_own_words_are_told(tmp_path):
    talk = """
static const fmi2CallbackFunctions *kept;
kept = functions;
kept->logger(kept->componentEnvironment, name, fmi2Error, "logStatusError", "no licence for %s", "motors");
return NULL;"""
    batch, failures, *_ = run(faulty_fmu(tmp_path, Instantiate=talk), [GOOD])
    assert batch.failed.all()
    assert failures[0].reason == "instantiate returned Error: no licence for motors"


def test_an_output_that_is_not_a_number_is_a_failure(tmp_path, good_cost):
    bad = 'fmi2Status s = ORIGINAL; if (getenv("BAD") && getenv("BAD")[0] == \'1\') values[0] = NAN; return s;'
    fmu = faulty_fmu(tmp_path, SetReal=MARK, GetReal=bad)
    batch, failures, *_ = run(fmu, [GOOD, BAD, GOOD])
    assert batch.costs.tolist() == [good_cost, np.inf, good_cost]
    assert failures[0].reason == "an output became infinite or not a number"


def test_when_everything_fails_the_error_says_why(tmp_path, case_of):
    fmu = faulty_fmu(tmp_path, DoStep="return fmi2Error;")
    with pytest.raises(SimulationError, match=r"every simulation of faulty.fmu failed: doStep returned Error"):
        estimate_recordings([case_of(fmu=fmu)], [[step_recording(CML050, duration=0.7)]])


# Side effects


def test_a_million_log_lines_cost_little(tmp_path, good_cost):
    flood = """
static const fmi2CallbackFunctions *kept;
if (functions) kept = functions;
for (int k = 0; k < 1000000; k++)
    kept->logger(kept->componentEnvironment, name, fmi2Warning, "logAll", "step %d", k);"""
    batch, failures, *_ = run(faulty_fmu(tmp_path, Instantiate=flood), [GOOD, GOOD])
    assert batch.costs.tolist() == [good_cost, good_cost] and not failures


def test_what_an_fmu_prints_goes_nowhere(tmp_path, good_cost, capfd):
    fmu = faulty_fmu(tmp_path, DoStep='printf("{\\"done\\": true}\\n"); fflush(stdout); fprintf(stderr, "noise\\n");')
    batch, *_ = run(fmu, [GOOD, GOOD])
    assert batch.costs.tolist() == [good_cost, good_cost]
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(sys.platform == "win32", reason="pipes are told from files by POSIX")
def test_an_fmu_that_writes_into_every_pipe_costs_its_process_at_most(tmp_path, good_cost):
    """What it writes where answers are expected may end its process, with what that is at then."""
    write = 'struct stat s; for (int k = 3; k < 64; k++) if (!fstat(k, &s) && S_ISFIFO(s.st_mode)) write(k, "x\\n", 2);'
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} {{ {write} }}")
    batch, *_ = run(fmu, [GOOD, BAD, *[GOOD] * 40])
    costs = np.delete(batch.costs, 1)
    assert set(costs) <= {good_cost, np.inf} and np.isinf(costs).sum() <= 1


def test_an_fmu_that_reads_standard_input_takes_no_orders_away(tmp_path, good_cost):
    fmu = faulty_fmu(tmp_path, DoStep="char line[80]; while (fgets(line, sizeof line, stdin) != NULL) {}")
    batch, *_ = run(fmu, [GOOD, GOOD], time_limit=10.0)
    assert batch.costs.tolist() == [good_cost, good_cost]


@pytest.mark.parametrize(
    "change",
    ["fesetround(FE_UPWARD);", 'setlocale(LC_ALL, "C.UTF-8");', 'fesetround(FE_TOWARDZERO); setlocale(LC_ALL, "");'],
    ids=["rounding", "locale", "both"],
)
def test_a_changed_floating_point_mode_or_locale_changes_no_cost(tmp_path, good_cost, change):
    fmu = faulty_fmu(tmp_path, DoStep=f"fmi2Status s = ORIGINAL; {change} return s;")
    batch, *_ = run(fmu, [GOOD, GOOD, GOOD])
    assert batch.costs.tolist() == [good_cost] * 3


@pytest.mark.usefixtures("started_workers")
def test_a_leaking_fmu_is_recycled_above_the_memory_limit(tmp_path, good_cost):
    leak = "static char *volatile lost; lost = malloc(1 << 20); memset(lost, 1, 1 << 20); return ORIGINAL;"
    fmu = faulty_fmu(tmp_path, EnterInitializationMode=leak)
    limit = 300 << 20
    with Workers(1, memory_limit=limit) as crew:
        crew.load(job_of(fmu))
        seen, peak = set(), 0
        for _ in range(12):
            batch = crew.run(np.tile(GOOD, (64, 1, 1)))
            assert np.all(batch.costs == good_cost) and not batch.failed.any()
            seen |= set(crew.pool.pids)
            peak = max(peak, psutil.Process(crew.pool.pids[0]).memory_info().rss)
        assert len(seen) > 1
        assert peak < limit + (200 << 20)


def test_the_search_goes_around_a_region_in_which_the_fmu_crashes(tmp_path, case_of):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, DoStep=f"{IF_BAD} abort();")
    (e,) = estimate_recordings([case_of(fmu=fmu, nests=8)], [[step_recording(CML050, duration=1.0)]])
    assert e.failed_simulations > 0
    first = re.search(r"SIGABRT\) \(first with R = .*, L = ([\d.]+),", e.failures[0])
    assert float(first[1]) > 0.02
    assert max(abs(e.parameters[n].value / CML050.parameters[n] - 1) for n in NAMES) < 1e-8


def test_a_missing_stepping_loop_is_told_with_its_remedy(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("estimator.stepping.library.STEPPER", tmp_path / "stepper.so")
    write_recording(step_recording(CML050, duration=0.6), tmp_path / "step.csv")
    for command in (["estimate", str(tmp_path / "step.csv")], ["simulate", "dc_motor"], ["inspect", "dc_motor"]):
        assert main(command) == 2
        assert capsys.readouterr().err == (
            f"fmu-estimator: {tmp_path / 'stepper.so'} is missing: an installation compiles it;"
            " install fmu-estimator again by pip\n"
        )


CHILD = "static int started; if (!started++ && fork() == 0) for (;;) pause();"
STAYS = 'FILE *f = fopen("NOTE", "w"); fprintf(f, "%d", (int)getpid()); fclose(f); for (;;) pause();'
LEAVES = f"static int started; if (!started++ && fork() == 0) {{ setsid(); {STAYS} }}"
ORPHAN = f"static int started; if (!started++ && fork() == 0) {{ setsid(); if (fork()) _exit(0); {STAYS} }}"


@pytest.mark.skipif(sys.platform == "win32", reason="fork is POSIX")
@pytest.mark.parametrize(
    "death",
    [
        pytest.param("", id="good", marks=pytest.mark.full),
        pytest.param(f"{IF_BAD} abort();", id="crash", marks=pytest.mark.full),
        pytest.param(f"{IF_BAD} pause();", id="hang"),
    ],
)
@pytest.mark.usefixtures("started_workers")
def test_what_an_fmu_starts_ends_with_it(tmp_path, death):
    fmu = faulty_fmu(tmp_path, SetReal=MARK, Instantiate=CHILD, DoStep=death or "return ORIGINAL;")
    children = set()
    with Workers(1, time_limit=2.0) as crew:
        crew.load(job_of(fmu))
        crew.pool.on_tick = lambda: children.update(c.pid for pid in crew.pool.pids for c in _children(pid))
        for candidate in (GOOD, BAD, GOOD):
            crew.run(np.array(candidate).reshape(1, 1, 5))
            children.update(c.pid for pid in crew.pool.pids for c in _children(pid))
    assert children
    limit = time.monotonic() + 30  # s, on a busy machine too
    while any(_alive(pid) for pid in children) and time.monotonic() < limit:
        time.sleep(0.05)
    assert not any(_alive(pid) for pid in children)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no /proc")
@pytest.mark.parametrize("child", [LEAVES, ORPHAN], ids=["leaves the group", "leaves its parent too"])
@pytest.mark.parametrize("death", ["return ORIGINAL;", f"{IF_BAD} abort();"], ids=["good", "crash"])
@pytest.mark.usefixtures("started_workers")
def test_a_child_that_leaves_its_workers_group_ends_with_the_worker(tmp_path, child, death):
    file = tmp_path / "child"
    fmu = faulty_fmu(tmp_path, SetReal=MARK, Instantiate=child.replace("NOTE", str(file)), DoStep=death)
    with Workers(1, time_limit=5.0) as crew:
        crew.load(job_of(fmu))
        crew.run(np.array([GOOD, BAD]).reshape(2, 1, 5))
        limit = time.monotonic() + 30
        while not (file.is_file() and file.read_text()) and time.monotonic() < limit:
            time.sleep(0.05)
        pid = int(file.read_text())
    limit = time.monotonic() + 30
    while _alive(pid) and time.monotonic() < limit:
        time.sleep(0.05)
    assert not _alive(pid)


def _children(pid):
    try:
        return psutil.Process(pid).children(recursive=True)
    except psutil.NoSuchProcess:
        return []


# The end of the owner


SCRIPT = """
import sys, threading, time
import numpy as np
sys.path[:0] = {path!r}
from test_containment import GOOD, job_of
from estimator.fmus.workers import Workers
crew = Workers(2)
crew.pool.busy_before_more = 0.0
crew.load(job_of({fmu!r}))
crew.pool.on_tick = lambda: print(*crew.pool.pids, crew._folder.path, flush=True)
crew.run(np.tile(GOOD, (50, 1, 1)))
"""


def start_owner(fmu):
    """Start a process whose workers hang in the FMU; return it, its workers' pids and its folder."""
    script = SCRIPT.format(path=[str(Path(__file__).parent), str(Path(__file__).parent.parent)], fmu=str(fmu))
    owner = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    for line in owner.stdout:
        *pids, folder = line.split()
        if len(pids) == 2:
            return owner, [int(p) for p in pids], Path(folder)
    raise AssertionError("the owner ended by itself")


def gone(pids, folder, *, within):
    limit = time.monotonic() + within
    while time.monotonic() < limit:
        if not folder.exists() and not any(_alive(p) for p in pids):
            return True
        time.sleep(0.05)
    return False


def _alive(pid):
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.fixture(scope="module")
def hanging_fmu(tmp_path_factory):
    return faulty_fmu(tmp_path_factory.mktemp("hanging"), DoStep="for (;;) {}")


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_after_a_kill_of_the_owner_workers_and_folder_go_within_two_seconds(hanging_fmu):
    owner, pids, folder = start_owner(hanging_fmu)
    assert folder.exists() and all(_alive(p) for p in pids)
    owner.kill()
    owner.wait()
    owner.stdout.close()
    assert gone(pids, folder, within=2.0)


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_after_a_kill_of_everything_the_next_start_cleans_up(hanging_fmu):
    owner, pids, folder = start_owner(hanging_fmu)
    for pid in (*pids, owner.pid):
        os.kill(pid, signal.SIGSTOP)  # so that none can tidy up after another
    for pid in (*pids, owner.pid):
        os.kill(pid, signal.SIGKILL)
    owner.wait()
    owner.stdout.close()
    assert folder.exists()
    with RunFolder():
        assert not folder.exists()


def test_the_folder_of_a_living_owner_is_left_alone():
    with RunFolder() as mine:
        remove_leftovers()
        assert (mine.path / LOCK).exists()
    assert not mine.path.exists()


def test_what_a_kill_leaves_of_a_removal_is_found_by_the_next_start(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    half, empty, young = (tmp_path / f"{PREFIX}{name}" for name in ("half", "empty", "young"))
    for folder in (half / "fmu-1", half / "fmu-2", empty, young):
        folder.mkdir(parents=True)
    (half / LOCK).touch()
    os.utime(empty, (0, 0))

    def killed(path, **_):
        raise KeyboardInterrupt

    with monkeypatch.context() as context, pytest.raises(KeyboardInterrupt):
        context.setattr(shutil, "rmtree", killed)
        remove(half)
    assert (half / LOCK).is_file()
    remove_leftovers()
    assert list(tmp_path.iterdir()) == [young]


@pytest.mark.parametrize("holds", [False, True])
def test_a_folder_that_another_start_takes_for_a_leftover_is_made_anew(tmp_path, monkeypatch, holds):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    taken = []

    def lock_late(file):  # another start comes between the folder and its lock
        if not taken:
            taken.append(Path(file.name).parent)
            with open(file.name, "r+") as other:
                assert try_lock(other)
                if holds:
                    return try_lock(file)
            remove_leftovers()
        return try_lock(file)

    monkeypatch.setattr(run_folder, "try_lock", lock_late)
    with RunFolder() as mine:
        assert (mine.path / LOCK).is_file() and mine.path != taken[0] and not taken[0].exists()
    assert not list(tmp_path.glob(PREFIX + "*"))


def test_no_folder_stays_behind_after_errors(tmp_path, case_of, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "own"))  # other tests may run at the same time
    (tmp_path / "own").mkdir()
    fmu = faulty_fmu(tmp_path, Instantiate="abort();")
    with pytest.raises(FmuError, match=r"faulty.fmu cannot be used: it does not run: it crashed \(SIGABRT\)"):
        estimate_recordings([case_of(fmu=fmu)], [[step_recording(CML050, duration=0.7)]])
    assert not list((tmp_path / "own").glob(PREFIX + "*"))


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to another process is POSIX")
def test_control_c_ends_at_once_and_reports_the_best_so_far(tmp_path):
    """The FMU is so slow that the search would take minutes; Ctrl-C comes once there is a best candidate."""
    recording, progress = tmp_path / "motor.csv", tmp_path / "progress.json"
    write_recording(step_recording(CML050), recording)
    slow = faulty_fmu(tmp_path, DoStep="for (volatile int k = 0; k < 1000; k++);")
    options = ["--fmu", str(slow), "--method", "original", "--progress-json", str(progress)]
    root = str(Path(__file__).resolve().parent.parent)
    run = subprocess.Popen(
        [sys.executable, "-m", "estimator", "estimate", str(recording), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": root},
        preexec_fn=takes_interrupts,
    )
    try:
        limit = time.monotonic() + 60
        while not (progress.exists() and '"best_cost": ' in progress.read_text().replace('"best_cost": null', "")):
            assert run.poll() is None and time.monotonic() < limit, "no candidate was found"
            time.sleep(0.05)
        children = [c.pid for c in psutil.Process(run.pid).children()]
        assert children
        started = time.monotonic()
        run.send_signal(signal.SIGINT)
        output, errors = run.communicate(timeout=20)
    finally:
        run.kill()
    assert time.monotonic() - started < 10  # s, on a busy machine too
    assert run.returncode == 130
    assert "Traceback" not in errors
    assert "best so far" in errors + output
    assert not any(_alive(p) for p in children)


def test_a_temporary_folder_that_may_be_written_but_not_listed_is_left_as_it_is(monkeypatch):
    """Of mode 1733, as machines of many users have it."""
    asked = []

    def refused(place):
        asked.append(place)
        raise PermissionError(13, "Permission denied", place)

    monkeypatch.setattr("os.listdir", refused)
    remove_leftovers()
    assert asked == [tempfile.gettempdir()]
