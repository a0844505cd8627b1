"""One candidate simulated by fmpy's methods alone: the reference of the stepping loop. Lives in a worker process."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

from estimator.recordings.sensors import Sensor
from estimator.stepping.fmu_instance import FmuInstance
from estimator.stepping.layout import MEAN, ExperimentLayout, JobLayout, positions


def reference_trajectories(
    loaded: FmuInstance,
    *,
    values: Sequence[float],
    experiment: int,
    inputs: Sequence[Sequence[float]],
    ends: Sequence[Sequence[float]] | None = None,
    times: Sequence[float] | None = None,
    refine: int = 1,
) -> list[list[float]]:
    """Simulate one candidate over one recording by fmpy's methods alone: the reference of the stepping loop.

    Parameters
    ----------
    values : (p,) the FMU's parameters, in its units, then the sensors' values
    experiment : index of the recording
    inputs : (n, inputs)
    ends : (n, inputs) where inputs that go linearly end before the next row; None: where they are there
    times : (n,) s; None: equidistant
    refine : communication steps are this many times finer

    Returns
    -------
    (n, outputs) what the sensors show; sample 0 is before the first step
    """
    layout = loaded.layout
    recording = layout.experiments[experiment]
    fmu = loaded.slow
    fmu.start, fmu.stop = recording.start, recording.start + recording.samples * recording.interval
    if times is not None:
        fmu.stop = float(times[-1]) + recording.interval
    if not fmu.fmu.component:
        fmu.instantiate()
    else:
        fmu.reset()
    parameters, driven, outputs = positions(layout)
    fmu.set(parameters, list(values)[: len(parameters)])
    for kind, reference, value in layout.settings:
        fmu.set_typed(kind, [reference], [value])
    chain = list(values)[len(parameters) :] or [0.0, *([1.0, 0.0, 0.0] * len(outputs))]
    fmu.enter()
    fmu.exit()
    equidistant = times is None
    times = [recording.start + k * recording.interval for k in range(recording.samples)] if times is None else times
    late = chain[3::3]
    acting = [time + chain[0] for time in times]
    reads = sorted({time - d for time in times for d in late if d and times[0] < time - d})
    breaks = [] if layout.even_steps else [*acting, *reads]
    kept: list[tuple[float, list[float]]] = []
    h = recording.interval / (recording.substeps * refine)

    def read(now: float) -> None:
        scale = layout.scale or ((1.0, 0.0),) * len(outputs)
        kept.append((now, [y * a + b for y, (a, b) in zip(fmu.get(outputs), scale, strict=True)]))

    read(times[0])
    for k, (begin, end) in enumerate(pairwise(times)):
        inside = _apart([t for t in breaks if begin < t < end - 1e-9 * h], begin, 1e-9 * h)
        for left, right in pairwise([begin, *inside, end]):
            steps = max(1, math.ceil((right - left) / h - 1e-6))
            for s in range(steps):
                now, length = left + s * (right - left) / steps, (right - left) / steps
                if equidistant and not inside:
                    now, length = recording.start + (k * steps + s) * h, h
                if driven:
                    fmu.set(driven, _means(layout, acting, (inputs, ends or inputs[1:]), now, now + length))
                fmu.step(now, length)
            read(right)
    shown = [_sensor(layout, recording, chain, j) for j in range(len(outputs))]
    rows = []
    for k, time in enumerate(times):
        interval = recording.interval if k == 0 or equidistant else time - times[k - 1]
        rows.append([sensor.show(_at(kept, time - late[j], j), interval) for j, sensor in enumerate(shown)])
    return rows


def _apart(instants: list[float], begin: float, least: float) -> list[float]:
    """Return instants in their order, without those that follow the one before, or the beginning, at once."""
    kept: list[float] = []
    for t in sorted(instants):
        if t > (kept[-1] if kept else begin) + least:
            kept.append(t)
    return kept


def _means(
    layout: JobLayout,
    acting: Sequence[float],
    inputs: tuple[Sequence[Sequence[float]], Sequence[Sequence[float]]],
    left: float,
    right: float,
) -> list[float]:
    """Return the mean of every input, from each row and to its end, between two instants: exact for lines."""
    tiny = 1e-9 * (right - left)
    cuts = [left, *(t for t in acting if left + tiny < t < right - tiny), right]
    result = []
    for j in range(len(inputs[0][0])):
        linear = bool(layout.linear) and layout.linear[j]
        column, ends = ([row[j] for row in rows] for rows in inputs)
        total = 0.0
        for a, b in pairwise(cuts):
            middle = (a + b) / 2
            row = bisect_right(acting, middle) - 1
            value = column[max(row, 0)]
            if linear and 0 <= row < len(column) - 1:
                share = (middle - acting[row]) / (acting[row + 1] - acting[row])
                value = (1 - share) * value + share * ends[row]
            total += value * ((b - a) / (right - left))
        result.append(total)
    return result


def _at(kept: list[tuple[float, list[float]]], time: float, output: int) -> float:
    """Return what an output read at an instant, on the line between the two nearest."""
    k = min(max(bisect_right(kept, time, key=lambda pair: pair[0]), 1), len(kept) - 1)
    (before, old), (after, new) = kept[k - 1], kept[k]
    share = min(max((time - before) / (after - before), 0.0), 1.0)
    if share in (0.0, 1.0):
        return new[output] if share else old[output]
    return old[output] + share * (new[output] - old[output])


def _sensor(layout: JobLayout, recording: ExperimentLayout, chain: Sequence[float], output: int) -> Sensor:
    average, sections = recording.chains[output] if recording.chains else (1, ())
    return Sensor(
        mean=layout.sensors[output] == MEAN,
        interval=recording.interval,
        average=average,
        sections=[tuple(section) for section in sections],  # type: ignore[misc]
        gain=chain[1 + 3 * output],
        offset=chain[2 + 3 * output],
    )
