"""What Python programs use: as small as the command line. Knows the parts, computes nothing itself.

Every quantity is in SI units. Sample k of an output is taken at time[k], before input[k] acts; input[k] holds to
time[k + 1].
"""

from __future__ import annotations

import inspect
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from estimator.api_sources import SIGNALS, Source, case_of, recording_of_arrays
from estimator.api_values import count, interval, listed, named_intervals, named_numbers, number
from estimator.api_words import words_of_python
from estimator.commands.options import reading, with_corrections, with_held_out, with_options, with_tolerances
from estimator.commands.sources import expanded
from estimator.errors import InputError, suggestion
from estimator.estimating.progress import Progress
from estimator.motor.winding import COLDEST, HOTTEST
from estimator.recordings.files import recordings_in
from estimator.results.result import FloatArray
from estimator.results.shown_result import Result

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from estimator.fmus.fmu import FmuDescription

MEANT = {
    "voltage": "v",
    "u": "v",
    "current": "i",
    "speed": "w",
    "omega": "w",
    "t": "time",
    "theta": "angle",
} | dict.fromkeys(
    ("path", "file", "files", "filename", "csv", "data", "df", "frame", "table", "recording", "recordings"), "source"
)


def estimate_parameters(
    source: Source | Sequence[Source] | None = None,
    *,
    time: ArrayLike | None = None,
    v: ArrayLike | None = None,
    i: ArrayLike | None = None,
    w: ArrayLike | None = None,
    angle: ArrayLike | None = None,
    load: ArrayLike | None = None,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    supply: float | str | None = None,
    counts: float | None = None,
    per_turn: float | None = None,
    rate: float | None = None,
    test: str | None = None,
    motor: str | None = None,
    fmu: str | os.PathLike[str] | None = None,
    kind: str | None = None,
    method: str | None = None,
    seed: int | None = None,
    fix: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    validate: Sequence[str | os.PathLike[str]] = (),
    window: tuple[float, float] | None = None,
    scale: Mapping[str, float] | None = None,
    offset: Mapping[str, float] | None = None,
    temperature: float | None = None,
    tolerance: Mapping[str, str | float] | str = "",
    loss: str | None = None,
    starts: Sequence[Mapping[str, float] | str | os.PathLike[str]] = (),
    workers: int | None = None,
    profile: bool = False,
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
    **unknown: object,
) -> Result:
    """Estimate a motor's parameters from recordings or a case.

    Parameters
    ----------
    source : path, table, Recording or Case; or a list of recordings, which are fitted together
        A recording's file or a pattern such as ``"run_*.csv"``, a case file (``*.case.toml``), either of them in
        memory, or a table: a DataFrame of pandas or polars, or a mapping of header → (n,) samples, such as
        ``{"time [s]": t, "voltage [V]": u, "current [mA]": i, "speed [rpm]": n}``.
    time, v, i, w, angle, load : (n,) arrays, optional
        Instead of a source: the signals in SI units (s, V, A, rad/s, rad, N.m); NaN is a missing sample.
    columns : signal → column, optional
        Which column of files and tables is "v", "i", "w", "angle" or "load", where their names do not tell.
    units : column or signal → unit, optional
        Of columns of files and tables, "time" too; wins over what their names say. ``result.read`` tells what was read.
    supply : float or str, optional
        Of a duty cycle: volts, volts a count ("12/255"), or the column that holds them.
    counts : float, optional
        Of an encoder a turn, of a column of counts.
    per_turn : float, optional
        m that a turn goes, of a column in m/s or m.
    rate : float, optional
        Hz, of the samples of a file that has no time.
    test, motor : str, optional
        Which, of a file that holds several.
    fmu : str or path, optional
        An .fmu file or a bundled model's name; by default the case's, else "dc_motor".
    kind : str, optional
        "co-simulation" or "model-exchange", of an FMU that offers both; by default co-simulation.
    method : str, optional
        "cuckoo" (default), "paper" (Rodríguez-Abreo et al. 2021), "original", "integral", "steiglitz-mcbride" or
        "differential-evolution".
    seed : int, optional
        Same seed, same result, for any number of workers.
    fix : name → value, optional
        Parameters that are known, SI units.
    bounds : name → (lower, upper), optional
        SI units; typical of a small motor: R 0.1 to 50 Ohm, K 0.001 to 1 V.s/rad, L 1e-5 to 0.1 H.
    validate : paths of recordings, or patterns
        Compared with, not fitted to.
    window : (from, to), optional
        s, of the recording's own time; only samples within are used.
    scale, offset : channel → value, optional
        Factor on a channel's samples (-1 turns the sign), and what is added after it, SI units.
    temperature : float, optional
        Of the winding, °C; R is then given at 25 °C too.
    tolerance : source → size, or "default"
        What no recording tells: {"i gain": "1 %", "supply resistance": "0.05 Ohm"}; part of every ``uncertainty``.
    loss : str, optional
        "linear" (default), or "huber": outliers pull less.
    starts : values or paths
        Further starts, each polished beside the search: {"R": 3, "K": 0.05} in SI units, or a CSV or result.json.
    workers : int, optional
        Processes that simulate; by default the cores that this process may use.
    profile : bool
        Simulate how the cost rises around every estimate, for the report.
    progress : callable, optional
        Told where the estimation stands.
    tell : callable, optional
        Told, before a search that is long, what one simulation costs and how long it will take; by default the logger
        "fmu-estimator" is, as a warning.

    Returns
    -------
    Result

    Raises
    ------
    InputError
        Something in the recording, the case or the arguments is wrong.
    SimulationError
        The FMU fails at every start.
    TypeError
        There is no such argument; the message names the one that is meant.
    """
    if unknown:
        _no_argument(next(iter(unknown)))
    from estimator.estimating.estimate import available_cores, estimate_by
    from estimator.estimating.kept_workers import kept_workers

    with words_of_python():
        arrays = {name: a for name, a in zip(SIGNALS, (v, i, w, angle, load), strict=True) if a is not None}
        if time is not None or arrays:
            if source is not None:
                raise InputError("signals are given twice, as a source and as arrays; leave one out")
            source = recording_of_arrays(time, arrays, fixed=fix if isinstance(fix, Mapping) else ())
        if source is None:
            raise InputError("nothing to estimate from; give a recording's file, a table, or the arrays time, v, i, w")
        said = reading(
            column=_pairs("columns", columns, "{'i': 'current A'}"),
            unit=_pairs("units", units, "{'speed': 'rpm'}"),
            rate=None if rate is None else number("rate", rate, above=0),
            test=test,
            motor=motor,
            per_turn=None if per_turn is None else number("per_turn", per_turn, above=0),
            counts=None if counts is None else number("counts", counts, above=0),
            supply=None if supply is None else str(supply),
        )
        case, recordings = case_of(source, said)
        case = with_options(
            case,
            fmu=None if fmu is None else os.fspath(fmu),
            kind=kind,
            method=method,
            seed=None if seed is None else count("seed", seed, least=0),
            fix=named_numbers("fix", fix),
            bounds=named_intervals("bounds", bounds),
            loss=loss,
            starts=[
                dict(named_numbers("starts", s)) if isinstance(s, Mapping) else os.path.abspath(s)
                for s in listed(starts)
            ],
        )
        case = with_corrections(
            case,
            window=None if window is None else interval("window", window),
            scale=named_numbers("scale", scale),
            offset=named_numbers("offset", offset),
            temperature=None
            if temperature is None
            else number("temperature", temperature, above=COLDEST, below=HOTTEST),
            read_as=said,
        )
        case = with_tolerances(case, tolerance)
        held_out = expanded([os.fspath(path) for path in listed(validate)])
        if recordings is None:
            case = with_held_out(case, held_out, fitted=len(case.recordings))
        else:  # read here, with as many tests as each file holds
            found = [(path, r) for path in held_out for r in recordings_in(Path(path), said)]
            case = with_held_out(case, [path for path, _ in found], fitted=len(recordings))
            recordings = [*recordings, *(r for _, r in found)]
        with kept_workers(available_cores() if workers is None else count("workers", workers, least=1)) as crew:
            return Result.of(
                estimate_by(
                    crew,
                    case,
                    recordings=recordings,
                    progress=progress,
                    tell=tell or logging.getLogger("fmu-estimator").warning,
                    profile=profile,
                )
            )


def simulate_fmu(
    fmu: str | os.PathLike[str],
    *,
    times: FloatArray,
    parameters: Mapping[str, float] | None = None,
    inputs: Mapping[str, FloatArray] | None = None,
) -> dict[str, FloatArray]:
    """Simulate an FMU from rest, in a process of its own, and return its outputs.

    Parameters
    ----------
    fmu : str or path
        An .fmu file or a bundled model's name.
    times : (n,) array
        s, increasing in equal steps, each one communication step; typically 1e-3.
    parameters : name → value, optional
        In the FMU's units; the others keep their start values.
    inputs : name → (n,) array, optional
        In the FMU's units; inputs[k] holds from times[k] to times[k + 1].

    Returns
    -------
    name → (n,) array
        All real outputs, in the FMU's units.

    Raises
    ------
    InputError
        No such FMU, parameter or input, times that are not equidistant, or an input that is not as long as they are.
    SimulationError
        The FMU failed.

    Examples
    --------
    >>> import numpy as np
    >>> times = np.linspace(0.0, 0.5, 501)
    >>> shown = simulate_fmu("dc_motor", times=times, inputs={"v": np.full(501, 10.5)})
    >>> round(float(shown["w"][-1]), 1)
    176.1
    """
    from estimator.fmus.simulate import simulate

    return simulate(os.fspath(fmu), parameters=parameters or {}, inputs=inputs or {}, times=times)


def describe_fmu(fmu: str | os.PathLike[str]) -> FmuDescription:
    """Return what an FMU says of itself: variables with units and start values, kinds, platforms. Runs nothing of it.

    Parameters
    ----------
    fmu : str or path
        An .fmu file or a bundled model's name.

    Raises
    ------
    InputError
        It is no FMU, or a damaged one.

    Examples
    --------
    >>> motor = describe_fmu("dc_motor")
    >>> [f"{v.name} [{v.unit}]" for v in motor.variables if v.causality == "parameter"]
    ['R [Ohm]', 'K [V.s/rad]', 'L [H]', 'J [kg.m2]', 'B [N.m.s/rad]']
    """
    from estimator.fmus.fmu import describe

    return describe(fmu if isinstance(fmu, str) else Path(fmu))


def _pairs(name: str, said: Mapping[str, str] | None, example: str) -> tuple[tuple[str, str], ...]:
    if said is None:
        return ()
    if not isinstance(said, Mapping) or not all(isinstance(text, str) for pair in said.items() for text in pair):
        raise InputError(f"{name}={said!r} is no mapping of names; give such as {name}={example}")
    return tuple(said.items())


def _no_argument(name: str) -> NoReturn:
    known = list(inspect.signature(estimate_parameters).parameters)[:-1]
    remedy = f"; did you mean {MEANT[name]!r}? ({', '.join(known)})" if name in MEANT else suggestion(name, known)
    raise TypeError(f"estimate_parameters has no argument {name!r}{remedy}")
