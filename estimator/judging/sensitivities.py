"""Before a search: whether every free parameter changes a measured signal, and what it will cost. Knows no search."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.problem import Problem

FloatArray = NDArray[np.float64]

NUDGE = 0.02  # of a parameter's range, on its scale
FAR_POINTS = (0.1, 0.5, 0.9)  # of its range, for a parameter whose nudge changes nothing
ELSEWHERE = 8  # points of the whole box: a friction may hold the motor at the start
TIMED, SHORT = 3, 0.5  # times that a simulation is timed; s, of one that is timed once
LONG = 10.0  # s: an estimation that takes longer is announced


def unmoved(problem: Problem, start: FloatArray) -> tuple[list[str], float]:
    """Return sentences about parameters without influence, and the time of one simulation, s.

    Nothing is said where the start cannot be simulated.

    Parameters
    ----------
    start : (p,) array
        Where the search begins.
    """
    box = problem.box
    home = box.to_cube(start)
    nudged = np.tile(home, (len(home), 1))
    np.fill_diagonal(nudged, np.where(home < 0.5, home + NUDGE, home - NUDGE))
    first = problem.trajectories(box.from_cube(home)[None, :])
    if first.failed[0] or first.shown is None:
        return [], 0.0
    seconds = np.inf
    for _ in range(TIMED):  # the least: another program may be in the way once
        began = time.monotonic()
        batches = [problem.trajectories(box.from_cube(nudged[:1]))]
        seconds = min(seconds, time.monotonic() - began)
        if seconds > SHORT:
            break
    if len(nudged) > 1:
        batches.append(problem.trajectories(box.from_cube(nudged[1:])))
    failed = np.concatenate([b.failed for b in batches])
    shown = np.concatenate([b.shown for b in batches if b.shown is not None])
    reference = problem.used(first.shown[0])
    sentences = []
    for j, parameter in enumerate(problem.parameters):
        if parameter.place is not None or failed[j]:
            continue
        unseen = np.array_equal(problem.used(shown[j]), reference) and not _moves_far(problem, home, j, reference)
        if unseen and not _moves_elsewhere(problem, j):
            signals = ", ".join(problem.outputs)
            sentences.append(
                f"parameter {parameter.name!r} moves no measured signal ({signals}), so it cannot be estimated; fix it"
                f" with --fix {parameter.name}=VALUE, or measure what it moves"
            )
    return sentences, seconds


def announcement(seconds: float, *, simulations: int, workers: int, always: bool = False) -> str | None:
    """Say what one simulation costs and how long the search will take; None if that is not long.

    Parameters
    ----------
    seconds : of one simulation; 0: not known
    simulations : that the method usually takes
    always : however short it is
    """
    total = seconds * simulations / max(1, workers)
    if seconds <= 0 or (total < LONG and not always):
        return None
    length = f"{total:.1g} s" if total < 10 else f"{total:.0f} s" if total < 120 else f"{total / 60:.0f} min"
    return (
        f"one simulation of this FMU takes {seconds:.2g} s; some {simulations} of them, by {workers}"
        f" worker{'s' if workers != 1 else ''}, will take about {length}, more where the model fits badly"
    )


def _moves_far(problem: Problem, home: FloatArray, j: int, reference: FloatArray) -> bool:
    """Whether a parameter changes a signal anywhere in its range, the others at the start."""
    tried = np.tile(home, (len(FAR_POINTS), 1))
    tried[:, j] = FAR_POINTS
    batch = problem.trajectories(problem.box.from_cube(tried))
    assert batch.shown is not None
    return any(
        failed or not np.array_equal(problem.used(shown), reference)
        for failed, shown in zip(batch.failed, batch.shown, strict=True)
    )


def _moves_elsewhere(problem: Problem, j: int) -> bool:
    """Whether a parameter changes a signal, the others anywhere in their ranges."""
    places = np.tile(np.random.default_rng(0).random((ELSEWHERE, len(problem.parameters))), (2, 1))
    places[:ELSEWHERE, j], places[ELSEWHERE:, j] = FAR_POINTS[0], FAR_POINTS[-1]
    batch = problem.trajectories(problem.box.from_cube(places))
    assert batch.shown is not None
    return any(
        not (batch.failed[k] or batch.failed[k + ELSEWHERE])
        and not np.array_equal(problem.used(batch.shown[k]), problem.used(batch.shown[k + ELSEWHERE]))
        for k in range(ELSEWHERE)
    )
