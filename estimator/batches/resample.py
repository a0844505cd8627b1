"""One case many times over: its best fit with other noise, by Monte-Carlo or bootstrap. Knows no batch.

The spread of the estimates checks the standard errors that each of them states.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from estimator.batches.case_worker import Task
from estimator.batches.drawn import BestFit, Drawn, Kind
from estimator.cases.case import Case, OutputSpec
from estimator.errors import InputError
from estimator.results.result import Estimate


def resampled(task: Task, estimate: Estimate, *, kind: Kind, count: int) -> Iterator[Task]:
    """Yield `count` tasks like this one, with recordings of the estimate's best fit and other noise.

    The noise follows from the case's seed and the task's number: the same task, the same recordings.

    Raises
    ------
    InputError
        The estimate was refused: there is no fit to repeat.
    """
    if not estimate.comparisons or not estimate.parameters:
        raise InputError(f"{task.name} has no fit to repeat: {'; '.join(estimate.reasons) or estimate.verdict}")
    case = _by_own_names(task.case, estimate)
    own = tuple(replace(c, left_out={}, taken_out={}, fine=None) for c in estimate.comparisons)
    fit = BestFit(own, estimate.noise, tuple(case.inputs), kind, case.search.seed)
    digits = len(str(count))
    for k in range(1, count + 1):
        yield replace(task, name=f"{task.name}[{kind} {k:0{digits}}]", case=case, drawn=Drawn(fit, k))


def _by_own_names(case: Case, estimate: Estimate) -> Case:
    """Return the case for recordings whose columns are called as the FMU's variables."""
    first = estimate.comparisons[0]
    held = {*case.fixed, *case.fixed_texts}
    outputs = {n: _by_own_name(case.outputs.get(n, OutputSpec(n)), n) for n in first.measured}
    inputs = {n: n for n in first.inputs if n not in held}
    return replace(case, inputs=inputs, outputs=outputs, products={}, runs=(), motor=case.motor or case.name)


def _by_own_name(spec: OutputSpec, name: str) -> OutputSpec:
    """Return the sensor of a signal that is counted, filtered and corrected already."""
    return replace(spec, column=name, counts=None, filter=spec.filter or spec.both, both=None)
