"""One candidate simulated by fmpy's methods alone: the reference of the stepping loop. Lives in a worker process."""

from __future__ import annotations

import math
from collections.abc import Sequence

from estimator.layout import MEAN, ExperimentLayout, JobLayout, positions
from estimator.sensors import Sensor
from estimator.slave import LoadedFmu


def reference_trajectories(
    loaded: LoadedFmu,
    *,
    values: Sequence[float],
    experiment: int,
    inputs: Sequence[Sequence[float]],
    refine: int = 1,
) -> list[list[float]]:
    """Simulate one candidate over one recording by fmpy's methods alone: the reference of the stepping loop.

    Parameters
    ----------
    values : (p,) the FMU's parameters, in its units, then the sensors' values
    experiment : index of the recording
    inputs : (n, inputs)
    refine : communication steps are this many times finer

    Returns
    -------
    (n, outputs) what the sensors show; sample 0 is before the first step
    """
    layout = loaded.layout
    recording = layout.experiments[experiment]
    fmu = loaded.foreign
    fmu.start, fmu.stop = recording.start, recording.start + recording.samples * recording.interval
    if not fmu.fmu.component:
        fmu.instantiate()
    else:
        fmu.reset()
    parameters, driven, outputs = positions(layout)
    fmu.set(parameters, list(values)[: len(parameters)])
    for kind, reference, value in layout.settings:
        fmu.set_typed(kind, [reference], [value])
    delay, sensors = _sensors(layout, recording, list(values)[len(parameters) :])
    fmu.enter()
    fmu.exit()
    scale = layout.scale or ((1.0, 0.0),) * len(outputs)
    substeps = recording.substeps * refine
    h = recording.interval / substeps
    rows: list[list[float]] = []
    for k in range(recording.samples):
        read = [y * factor + offset for y, (factor, offset) in zip(fmu.get(outputs), scale, strict=True)]
        rows.append([sensor.show(y) for sensor, y in zip(sensors, read, strict=True)])
        if k + 1 == recording.samples:
            break
        whole = math.floor(delay / recording.interval)
        part = delay / recording.interval - whole
        old, new = (inputs[min(max(k - late, 0), len(inputs) - 1)] for late in (whole + 1, whole))
        spans = [(new, 0.0, recording.interval)]
        if part > 1e-9 and list(old) != list(new) and not layout.even_steps:
            spans = [(old, 0.0, part * recording.interval)]
            spans += [(new, spans[0][2], recording.interval - spans[0][2])]
        elif part > 1e-9:
            spans = [([part * a + (1 - part) * b for a, b in zip(old, new, strict=True)], 0.0, recording.interval)]
        for held, begin, length in spans:
            if driven:
                fmu.set(driven, list(held))
            steps = substeps if length == recording.interval else max(1, math.ceil(length / h - 1e-9))
            for s in range(steps):
                if length == recording.interval:
                    fmu.step(recording.start + (k * substeps + s) * h, h)
                else:
                    now = recording.start + k * recording.interval + begin
                    fmu.step(now + s * (length / steps), length / steps)
    return rows


def _sensors(layout: JobLayout, recording: ExperimentLayout, values: Sequence[float]) -> tuple[float, list[Sensor]]:
    """Return the delay [s] and the outputs' sensors."""
    sensors = []
    for j, kind in enumerate(layout.sensors):
        average, sections = recording.chains[j] if recording.chains else (1, ())
        gain, offset = values[1 + 2 * j : 3 + 2 * j] if values else (1.0, 0.0)
        sensors.append(
            Sensor(
                mean=kind == MEAN,
                interval=recording.interval,
                average=average,
                sections=[tuple(section) for section in sections],  # type: ignore[misc]
                gain=gain,
                offset=offset,
            )
        )
    return (values[0] if values else 0.0), sensors
