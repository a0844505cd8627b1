"""What a figure shows beside the samples: outliers, ripple, a finer grid. Knows a fit, and judges nothing."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.explained import REPORTED, Explained
from estimator.fitting.problem import Problem
from estimator.fmus.workers import Workers
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.results.panels import MARKERS_UP_TO, transient
from estimator.results.result import Comparison, FineSignals
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

FINER = 10  # times the recording's grid
GRIDS_AGREE = 0.01  # of a signal's range: a simulation on a finer grid that differs by more at the samples is not used


def with_treatment(compared: tuple[Comparison, ...], explained: Explained) -> tuple[Comparison, ...]:
    """Return the comparisons with the outliers that were weighted down, and the ripple that was estimated."""
    fit = explained.fit
    ripple = fit.explained - explained.shown_rows()
    found = []
    for comparison, clock in zip(compared, fit.simulator.clocks, strict=True):
        left_out, taken_out = {}, {}
        for j, name in enumerate(fit.simulator.outputs):
            out = fit.whitener.inflate[clock.rows, j] > 1
            if out.any():
                left_out[name] = out
            if np.abs(ripple[clock.rows, j]).max(initial=0.0) > 0:
                taken_out[name] = ripple[clock.rows, j]
        found.append(dataclasses.replace(comparison, left_out=left_out, taken_out=taken_out))
    return tuple(found)


def with_fine_signals(
    compared: tuple[Comparison, ...], plan: Plan, values: FloatArray, crew: Workers, *, sigma: Mapping[str, float]
) -> tuple[Comparison, ...]:
    """Return the comparisons with the simulation between their samples, where the enlarged part has few of them.

    One simulation of the estimate, (p,), a recording. Sensors that filter have no finer grid: those are left as they
    are, and so are recordings whose clock is uneven, or in which a large effect was found: the FMU alone is simulated.
    """
    if any(chain.filters for chain in plan.chains.values()):
        return compared
    return tuple(
        comparison if (fine := _fine(comparison, plan, e, values, crew, sigma)) is None else fine
        for e, comparison in enumerate(compared)
    )


def _fine(
    comparison: Comparison, plan: Plan, e: int, values: FloatArray, crew: Workers, sigma: Mapping[str, float]
) -> Comparison | None:
    """Return one comparison with its finer grid; None where it needs none, or the FMU cannot step so finely."""
    start, end = transient(comparison)
    first, beyond = np.searchsorted(comparison.time, [start, end], side="right").tolist()
    if beyond - first > MARKERS_UP_TO or not plan.observed[e].recording.even:
        return None
    one = _finer(plan, e, rows=min(beyond + 1, len(comparison.time)))
    kept = [plan.names.index(name) for name in one.names]
    problem = Problem(one, crew, sigma=sigma, keep_counts=True)
    batch = problem.trajectories(values[kept][None, :])
    if batch.failed[0] or batch.shown is None:
        return None
    (rows,) = problem.shown(batch)
    seen = slice(FINER * max(first - 1, 0), None)
    shown = {name: _memory(rows[:, j], plan, name) for j, name in enumerate(plan.outputs)}
    for name, signal in shown.items():
        samples = comparison.simulated[name][: len(signal[::FINER])]
        beside = samples - signal[::FINER]  # of small effects outside the FMU
        if np.abs(beside).max() > GRIDS_AGREE * np.ptp(samples):  # an FMU that ignores its step, say, or a large effect
            return None
        shown[name] = signal + np.interp(np.arange(len(signal)), FINER * np.arange(len(beside)), beside)
    fine = FineSignals(one.observed[0].recording.time[seen], {name: signal[seen] for name, signal in shown.items()})
    return dataclasses.replace(comparison, fine=fine)


def _finer(plan: Plan, e: int, *, rows: int) -> Plan:
    """Return the plan of the first rows of one recording alone, on a finer grid, sensors without memory."""
    o = plan.observed[e]
    step = o.recording.step / FINER
    count = (rows - 1) * FINER + 1
    time = o.recording.time[0] + step * np.arange(count)
    held = np.arange(count) // FINER
    observed = Observed(
        recording=dataclasses.replace(o.recording, time=time, step=step),
        inputs={name: u[held] for name, u in o.inputs.items()},
        outputs={name: np.zeros(count) for name in o.outputs},
        excitation=o.excitation,
        lead=o.lead * FINER,
        rest=o.rest * FINER,
        delay=o.delay,
    )
    own = tuple(
        dataclasses.replace(
            p,
            recording=None if p.recording is None else 0,
            place=p.place
            if p.place is None or p.place.recording is None
            else dataclasses.replace(p.place, recording=0),
        )
        for p in plan.parameters
        if p.place != REPORTED and p.recording in (None, e) and (p.place is None or p.place.recording in (None, e))
    )
    return dataclasses.replace(
        plan,
        observed=(observed,),
        parameters=tuple(own),
        chains={name: dataclasses.replace(chain, average=1) for name, chain in plan.chains.items()},
        temperatures=plan.temperatures[e : e + 1],
        case=dataclasses.replace(plan.case, step=None if plan.case.step is None else min(plan.case.step, step)),
    )


def _memory(signal: FloatArray, plan: Plan, name: str) -> FloatArray:
    """Return a fine signal, (m,), as a sensor shows it that takes a mean over samples of the coarse grid."""
    if plan.sensors[name] == layout.MEAN:
        signal = _mean(signal, list(range(FINER)))
    return _mean(signal, [FINER * k for k in range(plan.chains.get(name, ChainSpec()).average)])


def _mean(signal: FloatArray, late: list[int]) -> FloatArray:
    """Return the mean of a signal and of itself so many rows later; its first value stands before it."""
    padded = np.concatenate([np.full(late[-1], signal[0]), signal])
    return np.asarray(np.mean([padded[late[-1] - k : len(padded) - k] for k in late], axis=0))
