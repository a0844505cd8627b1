"""An estimate that shows itself, as text and in a notebook, and writes itself. Knows no estimation."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estimator.errors import InputError
from estimator.results.named import Named
from estimator.results.reason import places_of
from estimator.results.result import Estimate

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure
    from scipy.signal import StateSpace


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
        from estimator.results.result_json import to_json

        return to_json(self)

    def plot(self) -> Figure:
        """Return the figure of measured and simulated signals and their residuals; ``.savefig(path)`` writes it.

        Raises
        ------
        InputError
            There is nothing to draw: the estimate was refused before anything was simulated.
        """
        from estimator.results.figure_process import drawable
        from estimator.results.plots import comparison_figure

        shown = drawable(self)
        if not shown:
            raise InputError(f"there is nothing to plot: the estimate is {self.verdict} ({'; '.join(self.reasons)})")
        return comparison_figure(shown, noise=self.noise, places=places_of(self.reasons))

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
        from estimator.results.report_text import text_report

        return text_report(self).rstrip("\n")

    def _repr_html_(self) -> str:
        from estimator.results.figure_process import draw
        from estimator.results.report_html import html_fragment

        return html_fragment(self, figure=draw(self, ("png",)).get("figure.png"))
