"""What the workers are asked, and what came of it: an FMU, its variables, recordings; costs. Knows no process."""

from __future__ import annotations

import mmap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from estimator.fmus.fmu import FmuDescription
from estimator.stepping.layout import Asked, ExperimentLayout, JobLayout

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Experiment:
    """What one recording asks of the FMU.

    Attributes
    ----------
    start, interval : float
        s; first sample and sampling interval.
    substeps : int
        Communication steps a sampling interval.
    inputs : (n, inputs) array
    measured : (n, outputs) array
        NaN: sample left out.
    weights : (outputs,) array
        1 / σ², in the outputs' units.
    chains : of each output (samples averaged, filter sections b0 b1 b2 a1 a2), or empty
    times : (n,) array, s, or None
        Increasing, from `start`; None: equidistant.
    ends : (n, inputs) array, or None
        Where inputs that go linearly end just before the next row; None: where they are there.
    """

    start: float
    interval: float
    substeps: int
    inputs: FloatArray
    measured: FloatArray
    weights: FloatArray
    chains: tuple[tuple[int, tuple[tuple[float, ...], ...]], ...] = ()
    times: FloatArray | None = None
    ends: FloatArray | None = None


@dataclass(frozen=True, kw_only=True)
class Job(Asked):
    """What to set and what to read of an FMU, and the experiments."""

    description: FmuDescription
    experiments: tuple[Experiment, ...]
    names: tuple[str, ...] = ()  # of parameters, settings and inputs, one after the other, for whoever reads of them

    def layout(self, folder: str, experiments: tuple[ExperimentLayout, ...]) -> JobLayout:
        """Return the job as it travels to a worker: the FMU's folder, and where the experiments' numbers stand."""
        fmu = self.description
        return JobLayout(
            **{field.name: getattr(self, field.name) for field in fields(Asked)},
            folder=folder,
            identifier=fmu.library or "",
            guid=fmu.guid,
            experiments=experiments,
            version=fmu.fmi_version,
            kind=fmu.kind,
            interpolates=bool(fmu.capabilities.get("canInterpolateInputs")) and fmu.fmi_version.startswith("2"),
            counts=fmu.counts,
        )

    def step(self, done: int, *, refine: int) -> tuple[float, float] | None:
        """Return begin and end, s, of the communication step of a candidate that so many others came before."""
        for e in self.experiments:
            substeps = e.substeps * refine
            if done < (len(e.measured) - 1) * substeps:
                h = e.interval / substeps
                return e.start + done * h, e.start + (done + 1) * h
            done -= (len(e.measured) - 1) * substeps
        return None


@dataclass(frozen=True)
class Failure:
    """One candidate that the FMU could not simulate.

    Attributes
    ----------
    step : s, begin and end of the communication step in which it failed; None: in none
    """

    reason: str
    values: tuple[float, ...]
    step: tuple[float, float] | None = None


@dataclass(frozen=True)
class Batch:
    """What became of a batch of candidates.

    Attributes
    ----------
    costs : (n,) array
        Infinity where cut short or failed.
    steps : (n,) array
        Communication steps done.
    failed : (n,) bool array
    shown : (n, rows, outputs) array or None
        Trajectories of all experiments, one after the other.
    """

    costs: FloatArray
    steps: IntArray
    failed: NDArray[np.bool_]
    shown: FloatArray | None

    def of(self, part: slice) -> Batch:
        """Return some of the candidates, as views."""
        shown = None if self.shown is None else self.shown[part]
        return Batch(self.costs[part], self.steps[part], self.failed[part], shown)


def laid_out(experiments: Sequence[Experiment]) -> tuple[tuple[ExperimentLayout, ...], int]:
    """Return where the experiments' numbers stand in memory, and how many bytes they take."""
    layouts, end = [], 0
    for experiment in experiments:
        offsets = {}
        for name, numbers in _numbers(experiment):
            offsets[name] = end
            end += 8 * numbers.size  # doubles
        layouts.append(
            ExperimentLayout(
                samples=len(experiment.measured),
                substeps=experiment.substeps,
                start=experiment.start,
                interval=experiment.interval,
                complete=not np.isnan(experiment.measured).any(),
                chains=experiment.chains,
                **offsets,
            )
        )
    return tuple(layouts), end + 8  # never empty


def write_numbers(memory: mmap.mmap, experiments: Sequence[Experiment], layouts: Sequence[ExperimentLayout]) -> None:
    """Write the experiments' numbers to where they stand."""
    for experiment, layout in zip(experiments, layouts, strict=True):
        for name, numbers in _numbers(experiment):
            there = np.frombuffer(memory, count=numbers.size, offset=getattr(layout, name))
            there.reshape(numbers.shape)[:] = numbers


def have_same_numbers(some: Sequence[Experiment], others: Sequence[Experiment]) -> bool:
    """Whether experiments have the same arrays, bit by bit, which then stand in the same places of memory."""
    if len(some) != len(others):
        return False
    return all(_are_same(dict(_numbers(a)), dict(_numbers(b))) for a, b in zip(some, others, strict=True))


def _are_same(some: dict[str, FloatArray], others: dict[str, FloatArray]) -> bool:
    return some.keys() == others.keys() and all(
        a.shape == others[name].shape and np.array_equal(a.view(np.int64), others[name].view(np.int64))
        for name, a in some.items()
    )


def _numbers(experiment: Experiment) -> Iterator[tuple[str, FloatArray]]:
    """Yield the arrays that a worker reads, by name."""
    for name in ("inputs", "measured", "weights", "times", "ends"):
        if (numbers := getattr(experiment, name)) is not None:
            yield name, numbers
