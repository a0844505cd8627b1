"""A search that is killed and goes on ends in the same result, bit for bit (checkpoint.py)."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from test_batch import EXAMPLE, ROOT

from estimator.batches.case_worker import CaseWorker
from estimator.cases.case import SearchSpec, case_for_recording
from estimator.errors import InputError
from estimator.estimating.checkpoint import Journal
from estimator.fmus.job import Batch, Failure
from estimator.results.result_json import to_mapping


def case_of(method, **search):
    return dataclasses.replace(case_for_recording(EXAMPLE), search=SearchSpec(method, **search))


def told(estimate):
    """Return all that an estimate says, but for the time that it took."""
    mapping = to_mapping(estimate)
    del mapping["seconds"]
    return json.dumps(mapping)


class Killed(BaseException):
    pass


SEARCHES = [
    ("cuckoo", {"iterations": 8}),
    ("paper", {"nests": 20, "iterations": 10}),
    ("differential-evolution", {"iterations": 5}),
]


@pytest.mark.parametrize(("method", "search"), SEARCHES)
def test_a_search_cut_off_anywhere_ends_in_the_same_result(method, search, tmp_path, monkeypatch):
    case = case_of(method, **search)
    path = tmp_path / "journal"
    with CaseWorker(processes=2) as case_worker:
        whole = told(case_worker.estimate(case))
        batches = 0
        original = Journal.append
        for stop in (1, 2, 2):
            left = [stop]

            def append(self, key, batch, failures, left=left):
                original(self, key, batch, failures)
                left[0] -= 1
                if left[0] == 0:
                    raise Killed

            monkeypatch.setattr(Journal, "append", append)
            with Journal(path, digest="d", after=0) as journal, pytest.raises(Killed):
                case_worker.estimate(case, journal=journal)
            batches += stop
        monkeypatch.setattr(Journal, "append", original)
        with open(path, "ab") as file:
            file.write(b"\x10\x00\x00\x00half a record")
        with Journal(path, digest="d", after=0) as journal:
            assert told(case_worker.estimate(case, journal=journal)) == whole
            assert journal.replayed > 0
            assert len(journal._records) == batches
        with Journal(path, digest="d", after=0) as journal:  # nothing is left to simulate but trajectories
            assert told(case_worker.estimate(case, journal=journal)) == whole


def batch_of(*costs):
    n = len(costs)
    return Batch(np.array(costs), np.arange(n), np.array([c == np.inf for c in costs]), None)


def test_a_journal_gives_back_what_it_took(tmp_path):
    keys = [bytes([k]) * 32 for k in range(3)]
    failure = Failure("crashed", (1.0, 0.1))
    with Journal(tmp_path / "j", digest="a", after=0) as journal:
        journal.append(keys[0], batch_of(1 / 3, np.inf), [failure])
        journal.append(keys[1], batch_of(2.0), [])
    with Journal(tmp_path / "j", digest="a", after=0) as journal:
        batch = journal.recall(keys[0])
        assert batch.costs.tolist() == [1 / 3, np.inf]
        assert batch.failed.tolist() == [False, True]
        assert journal.recalled_failures() == [failure]
        assert journal.recall(keys[2]) is None  # another search from here on: the rest is forgotten
        journal.append(keys[2], batch_of(3.0), [])
    with Journal(tmp_path / "j", digest="a", after=0) as journal:
        assert [journal.recall(key) is not None for key in (keys[0], keys[2], keys[1])] == [True, True, False]


def test_a_journal_of_another_search_is_not_used(tmp_path):
    with Journal(tmp_path / "j", digest="a", after=0) as journal:
        journal.append(bytes(32), batch_of(1.0), [])
    with Journal(tmp_path / "j", digest="b", after=0) as journal:
        assert journal.recall(bytes(32)) is None
        journal.append(bytes(32), batch_of(2.0), [])
    with Journal(tmp_path / "j", digest="b", after=0) as journal:
        assert journal.recall(bytes(32)).costs.tolist() == [2.0]
        journal.remove()
    assert not (tmp_path / "j").exists()


def test_a_short_search_writes_nothing(tmp_path):
    with Journal(tmp_path / "j", digest="a") as journal:
        journal.append(bytes(32), batch_of(1.0), [])
    assert not (tmp_path / "j").exists()


def test_a_file_that_is_no_journal_is_left_alone(tmp_path):
    (tmp_path / "thesis.txt").write_text("chapter 1")
    with pytest.raises(InputError, match=r"thesis\.txt is no checkpoint of a search; give the name of a new file$"):
        Journal(tmp_path / "thesis.txt", digest="a")
    with pytest.raises(InputError, match=r": cannot be read \(Is a directory\); give another file$"):
        Journal(tmp_path, digest="a")
    with pytest.raises(InputError, match=r"/none/j: there is no folder .*/none; make it first$"):
        Journal(tmp_path / "none" / "j", digest="a")
    (tmp_path / "gone").mkdir()
    with (
        pytest.raises(InputError, match=r"j: cannot be written \(No such file or directory\); make room$"),
        Journal(tmp_path / "gone" / "j", digest="a", after=0) as journal,
    ):
        (tmp_path / "gone").rmdir()
        journal.append(bytes(32), batch_of(1.0), [])


@pytest.mark.full
def test_the_command_killed_with_sigkill_goes_on(tmp_path):
    (tmp_path / "a.case.toml").write_text(
        f'[search]\nmethod = "paper"\nnests = 400\niterations = 1600\n[[recording]]\nfile = "{EXAMPLE}"\n'
    )
    command = [sys.executable, "-m", "estimator", "estimate", "a.case.toml", "--json", "--quiet"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def run(*more):
        process = subprocess.run([*command, *more], cwd=tmp_path, env=environment, capture_output=True, check=True)
        result = json.loads(process.stdout)
        del result["seconds"]
        return result

    whole = run()
    process = subprocess.Popen(
        [*command, "--checkpoint", "j"], cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL
    )
    deadline = time.monotonic() + 100
    while not (tmp_path / "j").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert (tmp_path / "j").exists()
    assert run("--checkpoint", "j") == whole
    assert not (tmp_path / "j").exists()
