"""Monte-Carlo and bootstrap of one case: the spread is what the standard errors say (resample.py, drawn.py)."""

import dataclasses
import pickle
import tracemalloc

import numpy as np
import pytest
from test_batch import EXAMPLE, tables_of

from estimator.batches import batch
from estimator.batches.batch import Digests, gather, repeated, run_batch
from estimator.batches.case_worker import CaseWorker
from estimator.batches.drawn import blocks
from estimator.batches.gauge import spreads
from estimator.batches.resample import resampled
from estimator.batches.worker_pool import run_here
from estimator.cli import main
from estimator.errors import InputError

pytestmark = pytest.mark.usefixtures("shared_workers")
FULL = pytest.param(24, 0.5, 1.65, marks=pytest.mark.full)


@pytest.fixture(scope="module")
def example():
    (task,) = gather([EXAMPLE]).tasks
    with CaseWorker() as case_worker:
        yield task, case_worker.estimate(task.case)


def test_blocks_are_pieces_of_the_circle():
    residuals = np.arange(100.0)[:, None] * [1, 2]
    drawn = blocks(residuals, np.random.default_rng(0))
    assert drawn.shape == (100, 2)
    assert np.all(drawn[:, 1] == 2 * drawn[:, 0])
    steps = np.diff(drawn[:, 0]) % 100
    assert np.count_nonzero(steps != 1) <= 9


def test_what_is_said_by_a_case_is_written_down_once_for_all_that_differ_in_their_noise_alone(example, monkeypatch):
    looked = []
    monkeypatch.setattr(batch, "fields", lambda case: looked.append(case) or dataclasses.fields(case))
    digests, tasks = Digests(), list(resampled(*example, kind="monte-carlo", count=20))
    found = [digests.of(task) for task in tasks]
    assert len(looked) == 1 and len(set(found)) == 20
    assert found == [Digests().of(task) for task in tasks]


@pytest.mark.parametrize("kind", ["monte-carlo", "bootstrap"])
def test_new_recordings_have_the_fit_and_noise_of_the_old_deviation(kind, example):
    task, estimate = example
    first, second = resampled(task, estimate, kind=kind, count=2)
    again, _ = resampled(task, estimate, kind=kind, count=2)
    assert (first.name, second.name) == (f"cml050_step[{kind} 1]", f"cml050_step[{kind} 2]")
    (recording,), (other,), (same,) = (t.drawn.recordings() for t in (first, second, again))
    (fit,) = estimate.comparisons
    for name in ("i", "w"):
        noise = recording.signals[name] - fit.simulated[name]
        assert np.std(noise) == pytest.approx(estimate.noise[name], rel=0.1)
        assert np.array_equal(recording.signals[name], same.signals[name])
        assert not np.array_equal(recording.signals[name], other.signals[name])
    assert np.array_equal(recording.signals["v"], fit.inputs["v"])


def test_a_thousand_repetitions_are_drawn_when_their_turn_comes(example):
    tracemalloc.start()
    try:
        tasks = list(resampled(*example, kind="bootstrap", count=1000))
        digests = {Digests().of(task) for task in tasks[:3]} | {Digests().of(pickle.loads(pickle.dumps(tasks[0])))}
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 5e6, "a recording has 90 kB"
    assert len(digests) == 3


def test_a_refused_estimate_has_nothing_to_repeat(example):
    task, estimate = example
    refused = dataclasses.replace(estimate, comparisons=(), reasons=("the voltage is zero",))
    with pytest.raises(InputError, match=r"^cml050_step has no fit to repeat: the voltage is zero$"):
        list(resampled(task, refused, kind="bootstrap", count=2))


def test_a_missing_sample_stays_missing(example):
    task, estimate = example
    (fit,) = estimate.comparisons
    current = np.array(fit.measured["i"])
    current[5] = np.nan
    measured = {**fit.measured, "i": current}
    holed = dataclasses.replace(estimate, comparisons=(dataclasses.replace(fit, measured=measured),))
    for kind in ("monte-carlo", "bootstrap"):
        (first, _) = resampled(task, holed, kind=kind, count=2)
        assert np.flatnonzero(np.isnan(first.drawn.recordings()[0].signals["i"])).tolist() == [5]


@pytest.mark.parametrize(("count", "narrowest", "widest"), [(8, 0.15, 2.3), FULL])
def test_the_spread_is_what_the_standard_errors_say(tmp_path, count, narrowest, widest):
    cases = repeated(gather([EXAMPLE]), kind="monte-carlo", count=count)
    result = run_batch(cases, tmp_path / "out", lambda tasks: run_here(tasks, processes=2))
    for s in spreads(result.rows):
        assert s.motors == 1
        # χ² with `count` - 1 degrees of freedom: outside with a probability of 1.5e-5 a parameter. The bar of B holds
        # besides what a single step leaves open, a dry part of the friction, which no noise shows; R's and J's, less.
        least = narrowest * {"B": 0.06, "R": 0.5, "J": 0.7}.get(s.name, 1.0)
        assert least < s.repeats / s.standard_error < widest, s.name


@pytest.mark.full
def test_resumed_on_the_command_line_it_is_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["batch", str(EXAMPLE), "--bootstrap", "3", "-o", "out"]) == 0
    before = tables_of(tmp_path / "out")
    assert main(["batch", str(EXAMPLE), "--bootstrap", "3", "-o", "out", "--resume"]) == 0
    assert "3 cases (3 of them from before): 3 ok" in capsys.readouterr().out
    assert tables_of(tmp_path / "out") == before
