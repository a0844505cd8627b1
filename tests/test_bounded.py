"""Bounded evaluation saves steps and changes nothing else: every nest of every generation is the same."""

import dataclasses

import numpy as np
import pytest
from motors import CML050, RMCS2004, step_recording

from estimator.estimating.cuckoo import CuckooSearch
from estimator.estimating.estimate import estimate_recordings

pytestmark = pytest.mark.usefixtures("shared_workers")

BOTH = pytest.mark.parametrize("motor", [RMCS2004, CML050], ids=lambda m: m.name)


def paths(monkeypatch, case_of, motor, method, *, seeds, iterations, nests):
    """Return, with and without bounds, all nests and costs of all generations, and the steps done."""
    kept = []
    tell = CuckooSearch.tell

    def keeping(self, eggs, costs):
        tell(self, eggs, costs)
        kept.append((self.nests.copy(), self.costs.copy()))

    monkeypatch.setattr(CuckooSearch, "tell", keeping)
    recording = step_recording(motor)
    results = []
    for bounded in (True, False):
        kept = []
        cases = []
        for seed in range(seeds):
            case = case_of(method, seed=seed)
            search = dataclasses.replace(case.search, iterations=iterations, nests=nests)
            cases.append(dataclasses.replace(case, search=search))
        found = estimate_recordings(cases, [[recording]] * seeds, bounded=bounded)
        results.append((kept, [[p.value for p in e.parameters.values()] for e in found], sum(e.steps for e in found)))
    return results


def check_same_path(results):
    (bounded, parameters, fewer), (unbounded, same, steps) = results
    assert len(bounded) == len(unbounded) > 0
    for (nests, costs), (other_nests, other_costs) in zip(bounded, unbounded, strict=True):
        assert np.array_equal(nests, other_nests) and np.array_equal(costs, other_costs)
    assert parameters == same
    assert fewer < steps


@pytest.mark.parametrize(
    ("method", "motor"),
    [
        pytest.param(method, motor, marks=() if (method == "paper") == (motor is CML050) else pytest.mark.full)
        for method in ("paper", "original", "cuckoo")
        for motor in (RMCS2004, CML050)
    ],
    ids=lambda x: x if isinstance(x, str) else x.name,
)
def test_the_path_of_the_search_is_the_same_with_and_without_bounds(monkeypatch, case_of, motor, method):
    check_same_path(paths(monkeypatch, case_of, motor, method, seeds=3, iterations=20, nests=30))


@pytest.mark.full
@BOTH
@pytest.mark.parametrize("method", ["paper", "original"])
def test_the_whole_paths_of_twenty_seeds_are_the_same(monkeypatch, case_of, motor, method):
    check_same_path(paths(monkeypatch, case_of, motor, method, seeds=20, iterations=100, nests=100))
