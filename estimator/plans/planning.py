"""From a case, an FMU and recordings to a plan: which column is what, what each sensor shows. Simulates nothing."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from estimator.cases.case import Case, RunSpec
from estimator.cases.expansion import told_apart
from estimator.cases.keys import FREE
from estimator.errors import CaseError, RecordingError, suggestion
from estimator.fmus.fmu import FmuDescription
from estimator.method_names import WITHOUT_POLISH
from estimator.plans.binding import Binding, bind
from estimator.plans.free_parameters import first_guess, free_parameters, held_inputs, held_parameters, units_taken
from estimator.plans.observing import check_delay, observe, within
from estimator.plans.parameters import SensorPlace
from estimator.plans.plan import ChainSpec, Observed, Plan
from estimator.plans.reading import with_reading, without_clipped, without_hidden_speeds
from estimator.recordings.differenced_counts import as_counted, counts_a_turn, counts_of_uneven_rows
from estimator.recordings.files import recordings_in
from estimator.recordings.filters import MAX_SECTIONS, filter_sections
from estimator.recordings.implausible_units import SIZES
from estimator.recordings.read_as import ReadAs
from estimator.recordings.recording import Recording
from estimator.stepping import layout


def plan_case(
    case: Case,
    description: FmuDescription,
    *,
    recordings: Sequence[Recording] | None = None,
    held_out: bool = False,
) -> Plan:
    """Make a case concrete.

    Parameters
    ----------
    recordings : sequence of Recording, optional
        Instead of reading the case's.
    held_out : bool
        Take the recordings that the case holds out to validate on, instead of those to fit to.

    Raises
    ------
    InputError
        A recording, a column, an FMU variable or a bound is wrong: one sentence.
    """
    if recordings is None:
        case, recordings = read_case(case)
    runs = [case.run(k) for k in range(len(recordings))]
    _check_held_out(recordings, runs)
    taken = [k for k, run in enumerate(runs) if run.validate == held_out]
    if not taken:
        raise CaseError('the case names no recording; add [[recording]] with file = "run.csv"')
    runs = [runs[k] for k in taken]
    named = _told_apart([recordings[k] for k in taken])
    read = [within(case, recording, run) for recording, run in zip(named, runs, strict=True)]
    binding = bind(case, description, read)
    observed = tuple(
        with_reading(binding, channels, observe(binding, channels, recording, run), scale=run.scale)
        for channels, recording, run in zip(binding.channels, read, runs, strict=True)
    )
    observed = without_clipped(binding, observed)
    observed = without_hidden_speeds(observed) if binding.is_motor else observed
    if not description.capabilities.get("canHandleVariableCommunicationStepSize", True):
        uneven = next((o.recording.title for o in observed if not o.recording.even), None)
        if uneven is not None:
            raise RecordingError(
                f"the clock of {uneven} jitters, and {description.path.name} takes steps of one size only;"
                " resample the recording to equal steps"
            )
    sensors, observed = _sensors(binding, observed)
    guess = first_guess(binding, observed)
    parameters = free_parameters(binding, guess, [o.recording.name for o in observed])
    if not held_out:
        _check_expected(case, [*(p.name for p in parameters), *binding.fixed], [*binding.outputs])
    return Plan(
        case=case,
        binding=binding,
        observed=observed,
        parameters=parameters,
        fixed=binding.fixed,
        sensors=sensors,
        guess=guess,
        notes=(
            *units_taken(binding),
            *held_parameters(binding),
            *held_inputs(binding),
            *_copies(observed),
            *(note for o in observed for note in o.notes),
        ),
        chains=_chains(binding, observed),
        declared=_declared(binding, runs),
        wanted=_wanted(binding, runs),
        temperatures=tuple(run.temperature for run in runs),
        stands_at=resistance_stands_at(runs),
    )


def resistance_stands_at(runs: Sequence[RunSpec]) -> float | None:
    """Return the temperature, °C, for which a shared R of recordings stands: the first one's, where all are known."""
    temperatures = [run.temperature for run in runs]
    return None if None in temperatures else next(iter(temperatures), None)


def _check_held_out(recordings: Sequence[Recording], runs: Sequence[RunSpec]) -> None:
    """Complain where samples that are fitted to are to show how well the fit predicts others."""
    whole = [(r.path, r.name, run.window) for r, run in zip(recordings, runs, strict=True)]
    fitted = [key for key, run in zip(whole, runs, strict=True) if not run.validate]
    for recording, key, run in zip(recordings, whole, runs, strict=True):
        if run.validate and recording.path is not None and key in fitted:
            raise CaseError(f"{recording.title} is fitted to, so it cannot validate the fit; give another recording")


def _check_expected(case: Case, parameters: Sequence[str], outputs: Sequence[str]) -> None:
    """Refuse what is expected of a parameter or an output that no estimate of the case will have."""
    for name in (*case.expect, *case.limits.standard_error):
        if name not in parameters:
            raise CaseError(f"[expect]: the estimate will have no parameter {name!r}{suggestion(name, parameters)}")
    for name in case.limits.rmse:
        if name not in outputs:
            raise CaseError(f"[expect]: the estimate will have no output {name!r}{suggestion(name, outputs)}")


def _copies(observed: Sequence[Observed]) -> list[str]:
    """Say which recordings hold the samples of one before them."""
    found, seen = [], dict[bytes, str]()
    for o in observed if len(observed) > 1 else ():
        content = hashlib.sha256()
        for signal in (*o.inputs.values(), *o.outputs.values()):
            content.update(np.ascontiguousarray(signal).data)
        first = seen.setdefault(content.digest(), o.recording.title)
        if first != o.recording.title:
            found.append(f"{o.recording.title} holds the same samples as {first}: the standard errors count them twice")
    return found


def _told_apart(recordings: Sequence[Recording]) -> Sequence[Recording]:
    """Return recordings with names that differ: those of one name get their folders' before it, or a number."""
    if len({r.name for r in recordings}) == len(recordings):
        return recordings
    names = told_apart([r.path or Path(f"{r.name} {k}") for k, r in enumerate(recordings, start=1)])
    return [replace(r, name=name) for r, name in zip(recordings, names, strict=True)]


def read_case(
    case: Case, *, read: Callable[[Path, ReadAs], Sequence[Recording]] = recordings_in
) -> tuple[Case, list[Recording]]:
    """Return a case with its recordings read; a file of several tests becomes as many recordings of the case.

    Parameters
    ----------
    read : what reads a file

    Raises
    ------
    InputError
        A file cannot be read: one sentence.
    """
    paths, runs, found = [], [], []
    for path, run in zip(case.recordings, case.runs_of(len(case.recordings)), strict=True):
        for recording in read(path, run.read_as):
            paths.append(path)
            runs.append(run)
            found.append(recording)
    if len(paths) > len(case.recordings):
        case = replace(case, recordings=tuple(paths), runs=tuple(runs))
    return case, found


def _sensors(binding: Binding, observed: tuple[Observed, ...]) -> tuple[dict[str, int], tuple[Observed, ...]]:
    """Return how each output is shown, and the recordings, with speeds that are counts, differenced, as such."""
    sensors = {}
    for name, spec in binding.outputs.items():
        is_open = spec.sensor == "auto" and spec.filter is None and spec.both is None
        counts = 0.0
        if is_open and name == "w" and binding.integral("w") is not None:
            counts = _counts_of(observed)
            if counts > 0:
                observed = tuple(_counted(o, counts) for o in observed)
        sensors[name] = layout.MEAN if counts > 0 or spec.sensor == "mean" else layout.IDENTITY
        if sensors[name] == layout.MEAN:
            observed = tuple(_from_first_interval(o, name) for o in observed)
        binding.read(name, sensors[name])
    return sensors, observed


def _from_first_interval(o: Observed, name: str) -> Observed:
    """Return a recording without the mean over the interval before its first row, where the motor moved in that."""
    y = o.outputs[name]
    if o.before or not y[0]:  # it is simulated; it stood
        return o
    return replace(o, outputs={**o.outputs, name: np.concatenate([[np.nan], y[1:]])})


def _counts_of(observed: tuple[Observed, ...]) -> float:
    """Return the counts a turn of the encoder whose differenced counts the speeds are; 0: they are none."""
    if all(o.recording.even for o in observed):
        return counts_a_turn([o.outputs["w"] for o in observed], [o.recording.step for o in observed])
    found = {counts_of_uneven_rows(o.outputs["w"], o.recording.time) for o in observed}
    return found.pop() if len(found) == 1 else 0.0


def _counted(o: Observed, counts: float) -> Observed:
    if not o.recording.even:
        return o  # each row has a step of its own
    return replace(o, outputs={**o.outputs, "w": as_counted(o.outputs["w"], o.recording.step, counts)})


def _chains(binding: Binding, observed: tuple[Observed, ...]) -> dict[str, ChainSpec]:
    chains = {}
    for name, spec in binding.outputs.items():
        filters = tuple(f for f in (spec.filter, spec.both) if f is not None)
        for used in filters:
            for o in observed:
                if not used.limit * o.recording.step < 0.5:
                    raise CaseError(
                        f"output {name!r}: the filter's cutoff {used.limit:g} Hz is not below half the sampling"
                        f" rate of {o.recording.title}, {0.5 / o.recording.step:g} Hz"
                    )
        sections = max(sum(len(filter_sections(f, step=o.recording.step)) for f in filters) for o in observed)
        if sections > MAX_SECTIONS:
            raise CaseError(
                f"output {name!r}: its filters have {sections} sections of second order together, of which"
                f" {MAX_SECTIONS} at most can be used; give filters of lower order"
            )
        chains[name] = ChainSpec(
            average=spec.average or 1,
            filters=filters,
            **{k: float(v) for k in ("gain", "offset", "delay") if isinstance(v := getattr(spec, k), float | int)},
            quantum=spec.quantum or 0.0,
        )
        for o in observed if binding.is_motor and name in SIZES else ():
            _check_size(name, chains[name], o)
        for o in observed if chains[name].delay else ():
            check_delay(chains[name].delay, o.excitation, o.recording, name)
    return {name: chain for name, chain in chains.items() if chain != ChainSpec()}


def _check_size(output: str, chain: ChainSpec, o: Observed) -> None:
    """Refuse a declared gain and offset by which a motor would have moved as none does."""
    if (chain.gain, chain.offset) == (1.0, 0.0):
        return
    least, most, title, unit = SIZES[output]
    largest = float(np.nanmax(np.abs(o.outputs[output] - chain.offset))) / abs(chain.gain)
    if not least <= largest <= most:
        raise CaseError(
            f"output {output!r}: by a gain of {chain.gain:g} and an offset of {chain.offset:g} the {title} in"
            f" {o.recording.title} went up to {largest:.4g} {unit}, as no motor's does; give those of its sensor"
        )


def _declared(binding: Binding, runs: Sequence[RunSpec]) -> frozenset[str]:
    """Return what the case says of the measurement chain, so that it is not looked for in the data."""
    found = {f"delay of {e}" for e, run in enumerate(runs) if run.delay is not None}
    for name, spec in binding.outputs.items():
        found |= {f"{key} {name}" for key in ("average", "gain", "offset", "delay") if getattr(spec, key) is not None}
        found |= {f"mean {name}"} if spec.sensor != "auto" else set()
    return frozenset(found)


def _wanted(binding: Binding, runs: Sequence[RunSpec]) -> tuple[SensorPlace, ...]:
    """Return what the case frees in the measurement chain."""
    wanted = [SensorPlace("delay", e) for e, run in enumerate(runs) if run.delay == FREE]
    for name, spec in binding.outputs.items():
        wanted += [SensorPlace(key, None, name) for key in ("gain", "delay") if getattr(spec, key) == FREE]
        wanted += [SensorPlace("offset", e, name) for e in range(len(runs)) if spec.offset == FREE]
    method = binding.case.search.method
    if wanted and method in WITHOUT_POLISH:
        raise CaseError(f'"free" sensor values are estimated by the method cuckoo only, not by {method}; give numbers')
    return tuple(wanted)
