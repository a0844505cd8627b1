"""A recording → what drives the FMU and what it is compared with: windows, corrections, counts, gaps."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case import Case, OutputSpec, RunSpec
from estimator.cases.case_signals import GIVEN, REST, SETTLED
from estimator.errors import CaseError, RecordingError, suggestion
from estimator.plans.binding import Binding, Channels
from estimator.plans.input_gaps import between_changes, complete, known_range, on_a_curve
from estimator.plans.plan import Observed
from estimator.recordings.corrected import corrected
from estimator.recordings.excitation import Excitation, find_delay, find_excitation
from estimator.recordings.filters import filter_sections
from estimator.recordings.printed_digits import errors_of_digits
from estimator.recordings.quantum import quantum
from estimator.recordings.recording import MIN_SAMPLES, Recording
from estimator.recordings.samples import filled, median
from estimator.recordings.sensors import Section, Sensor
from estimator.recordings.signal_noise import input_noise, noise_deviation
from estimator.recordings.smooth_inputs import jumps, moves_smoothly
from estimator.recordings.turns import OVERFLOW, counted_on, is_countable, starts_again, with_turns

FloatArray = NDArray[np.float64]

FIRST = 10  # samples that tell where an angle begins
SLOWLY = 1e-3  # of an input's range: less is no change
ONSET, STILL = 6.0, 0.01  # deviations of its noise; of the largest angle: less is where the model's begins
NONE = 6.0  # deviations of an input's noise: less is none
LATE = 2  # samples: a response that starts this much later than it could is delayed
UNDERWAY = 0.05  # of a speed: what changes by more before its voltage does has not settled
FILLED, RUNS = 3, 0.2  # signals that are zero at once; of the largest speed: no motor stands in the next row
RINGING = 1e-3  # of a filter's response: samples after a gap are left out until it has fallen below


def observe(binding: Binding, channels: Channels, recording: Recording, run: RunSpec) -> Observed:
    """Map a recording, `within` its window, on the FMU.

    Raises
    ------
    InputError
        A correction does not fit, or samples are missing: one sentence.
    """
    _check_channels(run, channels, recording)
    recording, filling = _without_filling(channels, recording) if binding.is_motor else (recording, [])
    recording, driven, told, early = _driven(binding, recording, channels.inputs, run)
    measured, more = _compared(binding, recording, channels.outputs, run)
    told = [*(f"{recording.title}: {sentence}" for sentence in recording.not_read), *filling, *told, *more]
    has_phase = "angle" in measured and quantum(measured["angle"]) > 0
    if not driven:  # the FMU moves by itself, as the motor did
        free = Excitation("several", 0, 0.0, 0.0, False)
        return Observed(recording, driven, measured, free, 0, notes=tuple(told), has_phase=has_phase)
    is_motor = binding.is_motor
    if is_motor and "angle" in measured:
        measured["angle"], more = _from_zero(recording, measured["angle"])
        told += more
    excitation = _excitation(driven, _moving(measured, recording.step))
    begin = run.begin or _usual_begin(binding, driven, measured)
    settles = begin is None and _settles(excitation, driven, measured)
    is_underway = settles or (begin is None and excitation.kind == "none" and excitation.running)
    if settles and excitation.kind == "none":  # its own response is one
        excitation = dataclasses.replace(excitation, kind="several")
    delay = _delay(begin, run, excitation, measured, recording)
    starts = is_motor and begin in (None, REST) and not excitation.running and excitation.kind != "none"
    rest = 1 if starts and any(u[0] != 0 for u in driven.values()) else 0
    found = Observed(
        recording, driven, measured, excitation, 0, delay, notes=tuple(told), has_phase=has_phase, rest=rest,
        at_rest=run.begin == REST, early=early, is_underway=is_underway,
        jumps={name: jumps(driven[name]) for name in binding.case.jumping},
        uncertain=errors_of_digits(driven["v"]) if is_motor and "v" in driven else None,
    )  # fmt: skip
    if begin in (GIVEN, REST):  # nothing to run in, and the way from there is a response
        by_itself = run.begin == GIVEN or not (run.begin or is_motor)  # a motor at zero does not move without its input
        kind = "several" if by_itself and excitation.kind == "none" else excitation.kind
        return dataclasses.replace(found, excitation=dataclasses.replace(excitation, kind=kind, running=False))
    return _run_in(found, run, settled=begin == SETTLED, is_motor=is_motor)


def _delay(
    begin: str | None, run: RunSpec, excitation: Excitation, measured: Mapping[str, FloatArray], recording: Recording
) -> float:
    """Return the delay of the outputs, s: as the case says it, else as the data show it at first sight."""
    if isinstance(run.delay, float | int):
        check_delay(float(run.delay), excitation, recording)
        return float(run.delay)
    if begin in (GIVEN, SETTLED) or excitation.kind == "none":
        return 0.0
    late = find_delay(excitation, measured)
    return late * recording.step if late >= LATE else 0.0


def _run_in(o: Observed, run: RunSpec, *, settled: bool, is_motor: bool) -> Observed:
    """Return a recording with what is simulated before it, where its first row shows something that runs already."""
    moves = settled or (o.excitation.running and o.excitation.kind != "none" and not o.is_underway)
    if not moves or all(abs(u[0]) <= NONE * input_noise(u) for u in o.inputs.values()):
        return o
    what = "the motor" if is_motor else "the FMU"
    note = (
        f"{o.recording.title}: {what} runs already in the first row; its simulation is run in at the first row's inputs"
        ' (begin = "settled"; "rest" or "given" under [[recording]] begins otherwise)'
    )
    return dataclasses.replace(
        o,
        lead=len(o.recording.time) - (o.excitation.index if o.excitation.kind == "step" else 0),
        has_phase="angle" in o.outputs and (o.has_phase or is_motor),
        delay=o.delay if isinstance(run.delay, float | int) else 0.0,
        notes=o.notes if run.begin else (*o.notes, note),
    )


def _without_filling(channels: Channels, recording: Recording) -> tuple[Recording, list[str]]:
    """Return a recording without the rows of zeros at its end that filled a logger's buffer, and what to tell.

    No shaft stands from one row to the next: of voltage, current and speed the last one cannot.
    """
    columns = [recording.column(name) for name in (*channels.inputs.values(), *channels.outputs.values())]
    used, speed = [recording.signals[column] for column in columns], channels.outputs.get("w")
    if speed is None or len(used) < FILLED:
        return recording, []
    rows, last = len(recording.time), np.flatnonzero(np.any([y != 0 for y in used], axis=0))
    if not len(last) or (end := int(last[-1]) + 1) == rows:
        return recording, []
    w = np.abs(recording.signals[recording.column(speed)])
    if not w[end - 1] > RUNS * np.nanmax(w):
        return recording, []
    many = "its last row is" if rows - end == 1 else f"its last {rows - end} rows are"
    told = f"{recording.title}: {many} all zero, though the motor runs in the row before: left out"
    return recording.between(0, end), [told]


def _settles(excitation: Excitation, driven: Mapping[str, FloatArray], measured: Mapping[str, FloatArray]) -> bool:
    """Whether a motor that runs in the first row by a voltage has not settled there, as it does before that changes."""
    if not excitation.running or "w" not in measured or "v" not in driven:
        return False
    v, w = driven["v"], filled(measured["w"])
    rows = excitation.index or (len(v) if excitation.kind == "none" else 0)
    if excitation.kind == "several" and moves_smoothly(v):  # slowly too: its level ends where it has left it
        left = np.abs(v - v[0]) > NONE * input_noise(v) + SLOWLY * float(np.ptp(v))
        rows = int(np.argmax(left))
        if rows < 3 * FIRST:
            return True  # it moved so before
    if rows < 3 * FIRST or not abs(median(v[:rows])) > NONE * input_noise(v):
        return False
    first, last = median(w[:FIRST]), median(w[rows - FIRST : rows])
    return abs(last - first) > UNDERWAY * max(abs(first), abs(last)) + ONSET * noise_deviation(w)


def _usual_begin(binding: Binding, driven: Mapping[str, FloatArray], measured: Mapping[str, FloatArray]) -> str | None:
    """Return how a simulation begins where the case does not say: a motor as the data show (None), else as given."""
    is_motor = "v" in driven and bool({"i", "w", "angle"} & set(measured))
    return None if is_motor and not binding.begins_elsewhere else GIVEN


def _driven(
    binding: Binding, recording: Recording, inputs: Mapping[str, str], run: RunSpec
) -> tuple[Recording, dict[str, FloatArray], list[str], float]:
    """Return the part of a recording in which every input is known, the inputs, (n,) each, what to tell, and `early`.

    That is for how many s before the first row they are not known, though they have changed.
    """
    driven = {}
    for name, column in inputs.items():
        unit = binding.signal(name).unit or None
        driven[name] = _corrected(
            _driving(binding.case, recording, name, column, unit, run), recording, name, column, run
        )
    curved = {n: on_a_curve(recording.time, u) for n, u in driven.items() if n not in binding.case.linear}
    notes = [
        f"{recording.title}: {name} has {many} missing samples, taken on a curve between the others"
        for name, u in curved.items()
        if (many := np.count_nonzero(np.isnan(driven[name]) & ~np.isnan(u)))
    ]
    driven |= curved
    rows = slice(*known_range(recording, driven))
    held = {name: signal for name, signal in driven.items() if name not in binding.case.linear}
    rows, told, early = between_changes(recording, held, inputs, rows)
    notes += [told] if told else []
    for name in driven:
        driven[name], more = complete(recording, driven[name], name, rows, linear=name in binding.case.linear)
        notes += more
    if rows.stop - rows.start < len(recording.time):
        recording = recording.between(rows.start, rows.stop)
    for name, value in binding.held_inputs.items():
        driven[name] = np.full(len(recording.time), value)
    return recording, driven, notes, early


def _compared(
    binding: Binding, recording: Recording, outputs: Mapping[str, str], run: RunSpec
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return what each output is compared with, (n,) each, and what to tell."""
    measured, told = {}, []
    for name, column in outputs.items():
        spec = binding.outputs[name]
        unit = binding.signal(name).unit or None
        measured[name] = _measured(recording, column, spec, unit=unit, name=name, run=run)
        if recording.units[recording.column(column)] == "rad" and starts_again(recording.signal(column)):
            told.append(f"{recording.title}: {column} starts again with every turn; its turns are added up")
        if spec.counts is not None and (bits := counted_on(recording.signals[recording.column(column)])[1]):
            told.append(f"{recording.title}: {column}: {OVERFLOW.format(bits)}")
        if np.isnan(measured[name]).all():
            raise RecordingError(f"{recording.title}: {column} has no sample that can be used; widen the window")
    return measured, told


def _excitation(driven: Mapping[str, FloatArray], measured: Mapping[str, FloatArray]) -> Excitation:
    """Find how the inputs move: the voltage, or the first, and where that does nothing, one of the others."""
    first, *others = sorted(driven, key=lambda name: name != "v")
    excitation = find_excitation(driven[first], measured)
    for name in others if excitation.kind == "none" else ():
        found = find_excitation(driven[name], measured)
        if found.kind != "none" and np.ptp(driven[name]) > 0:
            return dataclasses.replace(found, kind="several") if first == "v" else found  # a step is the voltage's
    return excitation


def _from_zero(recording: Recording, angle: FloatArray) -> tuple[FloatArray, list[str]]:
    """Return an angle, (n,), that begins at zero, as the model's does, and what to tell."""
    first = angle[~np.isnan(angle)][:FIRST]
    begins = median(first)
    noise = max(noise_deviation(angle), quantum(angle))
    moves = np.ptp(first) > ONSET * noise
    if abs(begins) <= ONSET * noise + STILL * moves * float(np.nanmax(np.abs(angle))):
        return angle, []
    return angle - begins, [f"{recording.title}: angle begins at {begins:.4g} rad; it is counted from there"]


def _moving(measured: Mapping[str, FloatArray], step: float) -> dict[str, FloatArray]:
    """Return what shows whether a motor moves: of an angle its slope."""
    return {name: np.gradient(filled(y), step) if name == "angle" else y for name, y in measured.items()}


def check_delay(delay: float, excitation: Excitation, recording: Recording, output: str = "") -> None:
    """Refuse a delay, of one output or of all, by which nothing of the response is in the recording."""
    length = float(recording.time[-1] - recording.time[0])
    begins = excitation.index * recording.step if excitation.kind == "step" else 0.0
    if not -length < begins + delay < length:
        raise CaseError(
            f"the delay of {delay:g} s puts the response{f' of {output}' if output else ''} outside {recording.title},"
            f" which is {length:g} s long; give a smaller one, in s"
        )


def within(case: Case, recording: Recording, run: RunSpec) -> Recording:
    """Return the window of a recording, its columns in the units that the case gives them.

    Raises
    ------
    RecordingError
        The window is too short.
    """
    for named in (*case.inputs.values(), *case.products.values(), *(spec.column for spec in case.outputs.values())):
        recording = recording.in_unit(named)
    if run.window is None:
        return recording
    low, high = run.window
    if recording.origin and high > recording.origin / 2:  # of the file's own clock, which counts from a date
        low, high = low - recording.origin, high - recording.origin
    tiny = 1e-6 * recording.step
    inside = np.flatnonzero((recording.time >= low - tiny) & (recording.time <= high + tiny))
    if len(inside) < MIN_SAMPLES:
        raise RecordingError(
            f"the window {low:g} to {high:g} s holds {len(inside)} samples of {recording.title}, which goes from"
            f" {recording.time[0]:g} to {recording.time[-1]:g} s; at least {MIN_SAMPLES} are needed"
        )
    return recording.between(int(inside[0]), int(inside[-1]) + 1)


def _check_channels(run: RunSpec, channels: Channels, recording: Recording) -> None:
    known = {**channels.inputs, **channels.outputs}
    for key in ("scale", "offset"):
        for name in getattr(run, key):
            if name not in known and name not in known.values():
                raise CaseError(
                    f"{key} is given for {name!r}, which is no channel of {recording.title} that is used"
                    f"{suggestion(name, known)}"
                )


def _corrected(signal: FloatArray, recording: Recording, name: str, column: str, run: RunSpec) -> FloatArray:
    scale, offset = (
        next((given[key] for key in (name, column) if key in given), default)
        for given, default in ((run.scale, 1.0), (run.offset, 0.0))
    )
    return corrected(signal, scale, offset, what=f"{name} of {recording.title}")


def _unit_of_sensor(recording: Recording, column: str, unit: str | None, name: str, run: RunSpec) -> str | None:
    """Return the unit a column is read in: volts, where a factor says what one of them is worth, as of a probe."""
    own = recording.column(column)
    in_volts = recording.units.get(own) == "V" and (name in run.scale or own in run.scale)
    return "V" if in_volts else unit


def _driving(case: Case, recording: Recording, name: str, column: str, unit: str | None, run: RunSpec) -> FloatArray:
    """Return an input's samples; a duty cycle times its supply."""
    if name not in case.products:
        return recording.signal(column, unit=_unit_of_sensor(recording, column, unit, name, run))
    other = recording.column(case.products[name])
    kinds = {recording.units[c] for c in (column, other)} & {"1", "", "?"}
    if not kinds:
        raise RecordingError(
            f"{recording.title}: of {column!r} and {other!r}, which are multiplied for {name!r}, one must be a ratio;"
            " give its unit as % or 1"
        )
    return recording.signals[recording.column(column)] * recording.signals[other]


def _measured(
    recording: Recording, column: str, spec: OutputSpec, *, unit: str | None, name: str, run: RunSpec
) -> FloatArray:
    """Return what an output is compared with."""
    header_unit = recording.units.get(recording.column(column), "")
    is_angle = spec.sensor == "mean" and unit == "rad/s" and header_unit == "rad"
    if spec.counts is not None:
        if header_unit not in ("", "?", "1", "count", "count/s"):
            raise RecordingError(
                f"{recording.title}: column {column!r} is in {header_unit}, so counts a turn do not fit it;"
                " leave counts out"
            )
        signal = counted_on(recording.signals[recording.column(column)])[0] * (2 * np.pi / spec.counts)
    else:
        unit = "rad" if is_angle else _unit_of_sensor(recording, column, unit, name, run)
        signal = recording.signal(column, unit=unit)
        if header_unit == "rad" and starts_again(signal):
            signal = _added_up(recording, column, signal)
    signal = _corrected(signal, recording, name, column, run)
    if is_angle or (spec.counts is not None and spec.sensor == "mean" and header_unit != "count/s"):
        signal = np.concatenate([[np.nan], np.diff(signal) / np.diff(recording.time)])
    elif name == "angle":
        signal = _without_rest(signal)
    if spec.both is None:
        return signal
    try:
        return _filtered(signal, filter_sections(spec.both, step=recording.step))
    except ValueError as error:
        raise CaseError(f"output {name!r}: {error} of {recording.title}; take a lower one") from None


def _added_up(recording: Recording, column: str, angle: FloatArray) -> FloatArray:
    whole = with_turns(angle)
    if not is_countable(whole):
        raise RecordingError(
            f"{recording.title}: {column!r} starts again with every turn and moves by nearly half a turn from row to"
            " row, so its turns cannot be counted; record faster, or the speed"
        )
    return whole


def _filtered(signal: FloatArray, sections: tuple[Section, ...]) -> FloatArray:
    """Return a signal filtered as the model's is, from a state of zero; what a gap reaches into is left out."""
    missing = np.isnan(signal)
    known = np.flatnonzero(~missing)
    sensor = Sensor(sections=sections)
    shown = np.array([sensor.show(float(x)) for x in np.interp(np.arange(len(signal)), known, signal[known])])
    if missing.any():
        impulse = Sensor(sections=sections)
        ringing = np.abs([impulse.show(float(k == 0)) for k in range(len(signal))])
        reach = int(np.flatnonzero(ringing > RINGING * ringing.max())[-1]) + 1
        gaps = np.convolve(missing, np.ones(reach))[: len(signal)] > 0.5
        shown[gaps] = np.nan
    return shown


def _without_rest(angle: FloatArray) -> FloatArray:
    """Leave out what an encoder shows before it counts first: its error is constant there."""
    known = angle[~np.isnan(angle)]
    resting = int(np.argmax(angle != known[0])) if quantum(angle) > 0 else 0
    resting = int(np.argmax(~np.isnan(angle) & (angle != known[0]))) if resting else 0
    return np.where(np.arange(len(angle)) < resting, np.nan, angle)
