"""What Python programs use: as small as the command line. Knows the parts, computes nothing itself.

Every quantity is in SI units. Sample k of an output is taken at time[k], before input[k] acts; input[k] holds to
time[k + 1].
"""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.cases.case import Case, case_for_recording, read_case
from estimator.commands.options import with_corrections, with_held_out, with_options, with_tolerances
from estimator.errors import InputError
from estimator.estimating.progress import Progress
from estimator.recordings.recording import Recording, read_recording
from estimator.results.result import Estimate, FloatArray

if TYPE_CHECKING:
    from scipy.signal import StateSpace

    from estimator.fmus.fmu import FmuDescription

CASE_SUFFIX = ".case.toml"
Source = str | os.PathLike[str] | Case | Recording


@dataclasses.dataclass(frozen=True, repr=False)
class Result(Estimate):
    """An estimate that shows itself, as text and in a notebook, and writes itself.

    All attributes are those of `estimator.results.result.Estimate`: ``verdict``, ``reasons``, ``parameters`` (name →
    value, standard error, unit, bounds, status), ``chain`` (the same for what was estimated of the measurement chain:
    delay, offsets), ``correlation``, ``rmse``, ``simulations``, ``comparisons``, …
    """

    @classmethod
    def of(cls, estimate: Estimate) -> Result:
        """Return an estimate as a result."""
        return cls(**{f.name: getattr(estimate, f.name) for f in dataclasses.fields(Estimate)})

    @property
    def values(self) -> dict[str, float]:
        """Parameter → estimate, SI units, the fixed ones included."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Parameter → standard error, SI units; None where it is fixed or not known."""
        return {name: parameter.standard_error for name, parameter in self.parameters.items()}

    @property
    def uncertainties(self) -> dict[str, float | None]:
        """Parameter → combined standard uncertainty, SI units: the standard error and what the tolerances add."""
        return {name: parameter.uncertainty for name, parameter in self.parameters.items()}

    def to_json(self) -> str:
        """Return the result as the command line's ``--json`` prints it."""
        from estimator.results.report import to_json

        return to_json(self)

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
        from estimator.results.linear import state_space

        return state_space(self.values)

    def __repr__(self) -> str:
        """Return the report as the command line prints it."""
        from estimator.results.report import text_report

        return text_report(self).rstrip("\n")

    def _repr_html_(self) -> str:
        from estimator.results.report_html import html_fragment

        return html_fragment(self)


def estimate_parameters(
    source: Source,
    *,
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
    workers: int | None = None,
    profile: bool = False,
    progress: Callable[[Progress], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Result:
    """Estimate a motor's parameters from a recording or a case.

    Parameters
    ----------
    source : path, Case or Recording
        A recording's file, a case file (``*.case.toml``), or either of them in memory.
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
        Of the winding, °C; R is then told at 25 °C too.
    tolerance : source → size, or "default"
        What no recording tells: {"i gain": "1 %", "supply resistance": "0.05 Ohm"}; part of every ``uncertainty``.
    loss : str, optional
        "linear" (default), or "huber": outliers pull less.
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
    """
    from estimator.estimating.estimate import available_cores, estimate_by
    from estimator.fmus.workers import Workers

    case, recordings = _case(source)
    case = with_options(
        case,
        fmu=None if fmu is None else os.fspath(fmu),
        kind=kind,
        method=method,
        seed=seed,
        fix=tuple((fix or {}).items()),
        bounds=tuple((bounds or {}).items()),
        loss=loss,
    )
    case = with_corrections(
        case,
        window=window,
        scale=tuple((scale or {}).items()),
        offset=tuple((offset or {}).items()),
        temperature=temperature,
    )
    case = with_tolerances(case, tolerance)
    case = with_held_out(case, validate, fitted=len(case.recordings if recordings is None else recordings))
    if recordings is not None:
        recordings = [*recordings, *(read_recording(Path(path)) for path in validate)]
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
    """
    from estimator.fmus.fmu import describe

    return describe(fmu if isinstance(fmu, str) else Path(fmu))


def _case(source: Source) -> tuple[Case, list[Recording] | None]:
    """Return the case that is meant, and its recordings where they are in memory."""
    if isinstance(source, Case):
        return source, None
    if isinstance(source, Recording):
        return Case(recordings=() if source.path is None else (source.path,)), [source]
    path = Path(source)
    if path.name.endswith(CASE_SUFFIX):
        return read_case(path), None
    if path.suffix in (".toml", ".fmu"):
        raise InputError(f"{path} is no recording; a case file's name ends in {CASE_SUFFIX}, an FMU is given as fmu=")
    return case_for_recording(path), None
