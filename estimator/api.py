"""What Python programs use: as small as the command line. Knows the parts, computes nothing itself.

Every quantity is in SI units. Sample k of an output is taken at time[k], before input[k] acts; input[k] holds to
time[k + 1].
"""

from __future__ import annotations

import dataclasses
import inspect
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from estimator.cases.case import Case, read_case
from estimator.commands.options import reading, with_corrections, with_held_out, with_options, with_tolerances
from estimator.commands.sources import CASE_SUFFIX, expanded
from estimator.errors import InputError, suggestion
from estimator.estimating.progress import Progress
from estimator.recordings.files import recordings_in
from estimator.recordings.read_as import AS_WRITTEN, ReadAs
from estimator.recordings.reading import recording_from_arrays
from estimator.recordings.recording import Recording
from estimator.results.named import Named
from estimator.results.reason import places_of
from estimator.results.result import Estimate, FloatArray

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike
    from scipy.signal import StateSpace

    from estimator.fmus.fmu import FmuDescription

Table = Any  # a mapping of header → (n,) samples, or a DataFrame of pandas or polars
Source = str | os.PathLike[str] | Case | Recording | Table
SIGNALS = ("v", "i", "w", "angle", "load")
ARRAYS = ("voltage [V]", "current [A]", "speed [rad/s]", "angle [rad]", "load torque [N.m]")  # headers of SIGNALS
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


@dataclasses.dataclass(frozen=True, repr=False)
class Result(Estimate):
    """An estimate that shows itself, as text and in a notebook, and writes itself.

    All attributes are those of `estimator.results.result.Estimate`: ``verdict``, ``reasons``, ``parameters`` (name →
    value, standard error, unit, bounds, status), ``chain`` (the same for what was estimated of the measurement chain:
    delay, offsets), ``correlation``, ``rmse``, ``simulations``, ``comparisons``, …
    """

    @classmethod
    def of(cls, estimate: Estimate) -> Result:
        """Return an estimate as a result; a name that its mappings do not have is answered with those they do."""
        fields = {f.name: getattr(estimate, f.name) for f in dataclasses.fields(Estimate)}
        named = ("parameters", "chain", "derived", "rmse", "fit_percent", "noise", "sensors")
        return cls(**{**fields, **{name: Named(fields[name]) for name in named}})

    @property
    def values(self) -> dict[str, float]:
        """Parameter → estimate, SI units, the fixed ones included."""
        return Named((name, parameter.value) for name, parameter in self.parameters.items())

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Parameter → standard error, SI units; None where it is fixed or not known."""
        return Named((name, parameter.standard_error) for name, parameter in self.parameters.items())

    @property
    def uncertainties(self) -> dict[str, float | None]:
        """Parameter → combined standard uncertainty, SI units: the standard error and what the tolerances add."""
        return {name: parameter.uncertainty for name, parameter in self.parameters.items()}

    def to_json(self) -> str:
        """Return the result as the command line's ``--json`` prints it."""
        from estimator.results.report import to_json

        return to_json(self)

    def plot(self) -> Figure:
        """Return the figure of measured and simulated signals and their residuals; ``.savefig(path)`` writes it.

        Raises
        ------
        InputError
            There is nothing to draw: the estimate was refused before anything was simulated.
        """
        figure = self._figure()
        if figure is None:
            raise InputError(f"there is nothing to plot: the estimate is {self.verdict} ({'; '.join(self.reasons)})")
        return figure

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row a quantity as pandas' DataFrame: the parameters, the measurement chain, what follows of them.

        Columns: kind ("parameter", "measurement", "derived"), value, standard_error, unit (SI), lower, upper,
        at_bound, status, reason, free; missing where a kind has no such thing.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError:
            raise InputError("to_dataframe needs pandas; install it with: pip install pandas") from None
        columns = ("value", "standard_error", "unit", "lower", "upper", "at_bound", "status", "reason", "free")
        rows = {}
        for kind, found in (("parameter", self.parameters), ("measurement", self.chain), ("derived", self.derived)):
            for name, quantity in found.items():
                rows[name] = {"kind": kind, **{column: getattr(quantity, column, None) for column in columns}}
        frame = pd.DataFrame.from_dict(rows, orient="index", columns=["kind", *columns])
        return frame.rename_axis("name").astype({c: float for c in ("value", "standard_error", "lower", "upper")})

    def _figure(self) -> Figure | None:
        from estimator.results.figure_process import drawable
        from estimator.results.plots import comparison_figure

        shown = drawable(self)
        return comparison_figure(shown, noise=self.noise, places=places_of(self.reasons)) if shown else None

    def save(self, folder: str | os.PathLike[str], *, figures: Sequence[str] = ()) -> tuple[Path, ...]:
        """Write result.json, report.html, parameters.ssv and figure.png to a folder; return their paths.

        Parameters
        ----------
        figures : "svg", "pdf"
            Formats of the figure besides PNG.

        Raises
        ------
        InputError
            The folder cannot be written.
        """
        from estimator.output import OutputFolder
        from estimator.results.export import RESULT_FILES, result_files

        files = result_files(self, sources=[path for path in [self.fmu.get("path")] if path], figures=figures)
        with OutputFolder(folder) as place:
            place.write(files, stale=RESULT_FILES)
        return tuple(Path(folder) / name for name in files)

    def export(
        self, folder: str | os.PathLike[str], *, formats: Sequence[str] = (), fmu: str | None = None
    ) -> tuple[Path, ...]:
        """Write files for other tools, as the command ``export`` does; return their paths.

        Parameters
        ----------
        formats : of "csv", "ssv", "ssp", "fmu", "matlab", "modelica", "state-space"
            Empty: all that the FMU allows.
        fmu : str, optional
            The FMU, if it has moved.

        Raises
        ------
        InputError
            A format that was asked for cannot be made, or the folder cannot be written.
        """
        from estimator.output import OutputFolder
        from estimator.results.handover_files import handover_files

        files, _ = handover_files(self, formats=formats, fmu=fmu)
        with OutputFolder(folder) as place:
            place.write(files)
        return tuple(Path(folder) / name for name in files)

    def state_space(self) -> StateSpace:
        """Return the motor as scipy's StateSpace: inputs v, load; states and outputs i, w.

        Raises
        ------
        InputError
            R, K, L, J and B are not all among the parameters.
        """
        from estimator.motor.state_space import state_space

        return state_space(self.values)

    def __repr__(self) -> str:
        """Return the report as the command line prints it."""
        from estimator.results.report import text_report

        return text_report(self).rstrip("\n")

    def _repr_html_(self) -> str:
        from estimator.results.plots import png
        from estimator.results.report_html import html_fragment

        figure = self._figure()
        return html_fragment(self, figure=None if figure is None else png(figure))


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
    validate : paths of recordings
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
    from estimator.fmus.workers import Workers

    arrays = {name: a for name, a in zip(SIGNALS, (v, i, w, angle, load), strict=True) if a is not None}
    if time is not None or arrays:
        if source is not None:
            raise InputError("signals are given twice, as a source and as arrays; leave one out")
        source = _from_arrays(time, arrays)
    if source is None:
        raise InputError("nothing to estimate from; give a recording's file, a table, or the arrays time, v, i, w")
    said = reading(
        column=_pairs("columns", columns, "{'i': 'current A'}"),
        unit=_pairs("units", units, "{'speed': 'rpm'}"),
        rate=rate,
        test=test,
        motor=motor,
        per_turn=per_turn,
        counts=counts,
        supply=None if supply is None else str(supply),
    )
    case, recordings = _case(source, said)
    case = with_options(
        case,
        fmu=None if fmu is None else os.fspath(fmu),
        kind=kind,
        method=method,
        seed=seed,
        fix=tuple((fix or {}).items()),
        bounds=tuple((bounds or {}).items()),
        loss=loss,
        starts=[dict(s) if isinstance(s, Mapping) else os.path.abspath(s) for s in starts],
    )
    case = with_corrections(
        case,
        window=window,
        scale=tuple((scale or {}).items()),
        offset=tuple((offset or {}).items()),
        temperature=temperature,
        read_as=said,
    )
    case = with_tolerances(case, tolerance)
    if recordings is None:
        case = with_held_out(case, validate, fitted=len(case.recordings))
    else:  # read here, with as many tests as each file holds
        found = [(path, r) for path in validate for r in recordings_in(Path(path), said)]
        case = with_held_out(case, [path for path, _ in found], fitted=len(recordings))
        recordings = [*recordings, *(r for _, r in found)]
    with Workers(workers or available_cores()) as crew:
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
        No such FMU, parameter or input, or times that are not equidistant.
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


def _case(source: Source | Sequence[Source], said: ReadAs) -> tuple[Case, list[Recording] | None]:
    """Return the case that is meant, and its recordings where they are in memory."""
    if isinstance(source, Case):
        return source, None
    sources = list(source) if isinstance(source, (list, tuple)) else [source]
    if not sources:
        raise InputError("the list of recordings is empty; give one at least")
    things: list[Path | Recording] = []
    for thing in sources:
        things += _recordings(thing, said, name="table" if len(sources) == 1 else f"table {len(things) + 1}")
    if said != AS_WRITTEN and all(isinstance(thing, Recording) for thing in sources):
        raise InputError(
            "columns, units and the like say how files and tables are read, and a Recording is read already; say them"
            " where it is made (arrays are in SI units)"
        )
    paths = [thing for thing in things if isinstance(thing, Path)]
    cases = [path for path in paths if path.name.endswith(CASE_SUFFIX)]
    if cases and len(things) > 1:
        raise InputError(f"{cases[0]} is a case file; give it alone: it names its own recordings")
    if cases:
        return read_case(cases[0]), None
    if len(paths) == len(things):
        expanded([os.fspath(path) for path in paths])  # each once
        return Case(recordings=tuple(Path(os.path.abspath(path)) for path in paths)), None
    found = [r for thing in things for r in (recordings_in(thing, said) if isinstance(thing, Path) else [thing])]
    named = tuple(recording.path for recording in found if recording.path is not None)
    return Case(recordings=named if len(named) == len(found) else ()), found


def _recordings(thing: Any, said: ReadAs, *, name: str) -> list[Path | Recording]:
    """Return the recordings that one source means: files, or one in memory."""
    from estimator.recordings.in_memory import is_table, recording_from_table

    if isinstance(thing, Recording):
        return [thing]
    if is_table(thing):
        return [recording_from_table(name, thing, said)]
    if isinstance(thing, Case):
        raise InputError("a Case stands for its own recordings; give it alone, or give recordings")
    if not isinstance(thing, (str, os.PathLike)):
        raise InputError(
            f"{type(thing).__name__} is no recording; give a file, a DataFrame, a mapping such as"
            ' {"time [s]": t, "voltage [V]": u, "current [A]": i}, or the arrays by name: time=, v=, i=, w='
        )
    path = Path(thing)
    if path.suffix in (".toml", ".fmu") and not path.name.endswith(CASE_SUFFIX):
        raise InputError(f"{path} is no recording; a case file's name ends in {CASE_SUFFIX}, an FMU is given as fmu=")
    return [Path(file) for file in expanded([os.fspath(thing)])]


def _from_arrays(time: ArrayLike | None, arrays: Mapping[str, ArrayLike]) -> Recording:
    if time is None or not arrays:
        missing = "the signals are" if not arrays else "time is"
        raise InputError(f"{missing} missing; give time=, v= and i= or w=, each (n,) in SI units")
    headers = dict(zip(SIGNALS, ARRAYS, strict=True))
    return recording_from_arrays("arrays", time, {headers[name]: array for name, array in arrays.items()})


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
