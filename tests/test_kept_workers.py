"""Worker processes stay from one estimation of a program to its next, and are as new ones would be."""

import dataclasses
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

import estimator
from estimator.estimating import kept_workers as module
from estimator.estimating.kept_workers import end_kept_workers, kept_workers
from estimator.fmus.fmu import describe

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "cml050_step.csv"


@pytest.fixture(autouse=True)
def none_wait():
    end_kept_workers()
    yield
    end_kept_workers()


def waiting():
    return [pid for _, crew in module._kept for pid in crew.pool.pids]


def estimated():
    result = estimator.estimate_parameters(EXAMPLE, workers=1)
    return {name: (p.value, p.standard_error) for name, p in result.parameters.items()}


def test_the_second_estimation_has_the_first_ones_process_and_its_very_numbers():
    first = estimated()
    pids = waiting()
    assert len(pids) == 1
    assert estimated() == first
    assert waiting() == pids


def test_what_waits_has_no_fmu_but_the_packages_files_and_no_shared_memory():
    estimated()
    ((_, crew),) = module._kept
    assert crew.job is None
    kept = [extracted.folder.name for extracted in crew._rested.values()]
    assert sorted(p.name for p in crew._folder.path.iterdir()) == [*sorted(kept), "owner.lock"]
    assert {file.stem for file in crew._rested} <= {"dc_motor", "dc_motor_drive"}
    held = Path(f"/proc/{crew.pool.pids[0]}/maps")
    if held.exists():
        limit = time.monotonic() + 10
        while "memfd:fmu-estimator" in held.read_text() and time.monotonic() < limit:
            time.sleep(0.02)
        assert "memfd:fmu-estimator" not in held.read_text()


def test_an_fmu_that_has_changed_meanwhile_is_the_new_one(tmp_path):
    fmu = tmp_path / "motor.fmu"
    shutil.copy(describe("dc_motor").path, fmu)
    first = estimator.estimate_parameters(EXAMPLE, fmu=fmu, workers=1)
    shutil.copy(describe("dc_motor_friction").path, fmu)
    second = estimator.estimate_parameters(EXAMPLE, fmu=fmu, workers=1)
    assert set(first.parameters) < set(second.parameters)


@pytest.mark.parametrize(("is_bundled", "changes"), [(True, False), (True, True), (False, False)])
def test_files_of_the_packages_own_fmus_stay_while_they_are_the_same(is_bundled, changes, tmp_path):
    file = tmp_path / "motor.fmu"
    shutil.copy(describe("dc_motor").path, file)
    description = dataclasses.replace(describe("dc_motor"), path=file, is_bundled=is_bundled)
    with kept_workers(1) as crew:
        first = crew._extracted(description)
        assert crew._extracted(description) == first
    assert first.is_dir() == is_bundled
    if changes:
        os.utime(file, (1, 1))
    with kept_workers(1) as again:
        assert again is crew
        assert (again._extracted(description) == first) == (is_bundled and not changes)


@pytest.mark.skipif(os.name != "posix", reason="a process is killed by a signal")
def test_one_that_has_died_meanwhile_is_not_taken():
    first = estimated()
    (pid,) = waiting()
    worker = psutil.Process(pid)
    worker.kill()
    psutil.wait_procs([worker], timeout=10)
    assert estimated() == first
    assert waiting() != [pid]


@pytest.mark.parametrize("change", ["count", "environment", "folder", "removed"])
def test_another_count_environment_or_folder_has_new_ones(change, monkeypatch, tmp_path):
    with kept_workers(1) as crew:
        pids = crew.pool.pids
    if change == "environment":
        monkeypatch.setenv("FMU_ESTIMATOR_TESTS_OTHER", "1")
    elif change == "folder":
        monkeypatch.chdir(tmp_path)
    elif change == "removed":
        shutil.rmtree(crew._folder.path)
    with kept_workers(2 if change == "count" else 1) as other:
        assert other is not crew
        assert not set(other.pool.pids) & set(pids)
    assert not any(psutil.pid_exists(pid) and psutil.Process(pid).status() != "zombie" for pid in pids)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_an_error_none_wait(error):
    with pytest.raises(error), kept_workers(1) as crew:
        pids = crew.pool.pids
        raise error
    assert not waiting()
    assert not any(psutil.pid_exists(pid) and psutil.Process(pid).status() != "zombie" for pid in pids)


def test_two_at_a_time_have_workers_of_their_own_and_one_waits():
    with kept_workers(1) as first, kept_workers(1) as second:
        assert first is not second
    assert len(waiting()) == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_forked_process_does_not_take_its_parents():
    with kept_workers(1) as crew:
        pids = crew.pool.pids
    child = os.fork()
    if child == 0:
        code = 1
        try:
            with kept_workers(1) as own:
                code = int(bool(set(own.pool.pids) & set(pids)))
            end_kept_workers()
        finally:
            os._exit(code)
    assert os.waitpid(child, 0)[1] == 0
    assert psutil.pid_exists(pids[0])
    with kept_workers(1) as again:
        assert again.pool.pids == pids


def test_a_program_that_ends_leaves_no_process_and_no_folder():
    code = (
        "import estimator\n"
        f"estimator.estimate_parameters({str(EXAMPLE)!r}, workers=1)\n"
        "from estimator.estimating.kept_workers import _kept\n"
        "((_, crew),) = _kept\n"
        "print(*crew.pool.pids, crew._folder.path)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    pid, folder = done.stdout.split()
    assert not psutil.pid_exists(int(pid))
    assert not Path(folder).exists()


def test_an_estimation_is_the_same_after_a_different_one():
    first = estimator.estimate_parameters(EXAMPLE, workers=1)
    estimator.estimate_parameters(EXAMPLE, workers=1, method="integral")
    again = estimator.estimate_parameters(EXAMPLE, workers=1)
    assert again.parameters["R"].value == first.parameters["R"].value
