"""What an estimate says in tables, for text and page alike. Knows only the result; computes nothing new."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from estimator.results.numbers import (
    ABSENT,
    deviation_text,
    finite_text,
    magnitude,
    number_text,
    relative_text,
    value_texts,
)
from estimator.results.result import Estimate, ParameterEstimate
from estimator.results.text_table import TextTable

SIGNAL_WORDS = (
    "RMSE: measured minus simulated, all samples. Residual: its standard deviation without outliers, without samples of"
    " a sensor that stands still, and without the ripple and drift that were found. Noise: by the recording alone, at"
    " rest or from sample to sample; of noise that grows with the motion or wanders it is less than the residual, of"
    " rounded samples it may be more."
)
UNIDENTIFIED_DIGITS = 3


def parameter_table(estimate: Estimate) -> TextTable:
    """Return rows of name, value, ± standard error, percent, unit, nominal, deviation, note.

    The columns of the nominal values are left empty (and not shown) when no nominal value is known.
    """
    return _estimate_table("parameter", estimate.parameters, said=estimate.reasons)


def chain_table(estimate: Estimate) -> TextTable:
    """Return what was estimated of the measurement chain, as `parameter_table`."""
    return _estimate_table("measurement", estimate.chain, said=estimate.reasons)


def _estimate_table(title: str, parameters: Mapping[str, ParameterEstimate], *, said: Iterable[str]) -> TextTable:
    header = [title, "estimate", "± std. error", "", "unit", "nominal", "deviation", "note"]
    rows = []
    for name, parameter in parameters.items():
        value, error, relative = estimate_texts(parameter)
        nominal = parameter.nominal
        rows.append(
            [
                name,
                value,
                f"± {error}" if error else (ABSENT if parameter.free else ""),
                relative,
                parameter.unit,
                "" if nominal is None else number_text(nominal),
                "" if nominal is None or not parameter.is_told else deviation_text(parameter.value, nominal),
                parameter_note(parameter, said=said),
            ]
        )
    return TextTable(header, rows, (1, 3, 5, 6))


def derived_table(estimate: Estimate) -> TextTable:
    """Return rows of what follows from the parameters, ± standard error, percent, unit."""
    rows = []
    for name, quantity in estimate.derived.items():
        value, error = value_texts(quantity.value, quantity.standard_error)
        relative = relative_text(quantity.standard_error, quantity.value)
        rows.append([name.replace("_", " "), value, f"± {error}", relative, quantity.unit])
    return TextTable(["derived quantity", "value", "± std. error", "", "unit"], rows, (1, 3))


def signal_table(estimate: Estimate) -> TextTable:
    """Return rows of output, RMSE, deviation of the treated residuals, noise of the data, unit, fit.

    RMSE is of all that was measured; `SIGNAL_WORDS` says what the others are.
    """
    units: dict[str, str] = {}
    for comparison in estimate.comparisons:
        units.update(comparison.units)
    rows = []
    for name, rmse in estimate.rmse.items():
        rows.append(
            [
                name,
                finite_text(rmse, ".4g"),
                finite_text(estimate.noise.get(name, math.nan), ".3g"),
                finite_text(estimate.sample_noise.get(name, math.nan), ".3g"),
                units.get(name, ""),
                _percent_of_fit(estimate.fit_percent.get(name)),
            ]
        )
    for column in (2, 3):
        if all(row[column] == ABSENT for row in rows):
            for row in rows:
                row[column] = ""
    return TextTable(["output", "RMSE", "residual", "noise", "", "fit"], rows, (1, 2, 3, 5))


def estimate_texts(parameter: ParameterEstimate) -> tuple[str, str, str]:
    """Return value, standard error and percent as text.

    Of what is not identified a few digits and no error; nothing where it has no error: any value fits as well.
    """
    if not parameter.is_told:
        return ABSENT, "", ""
    value, error = value_texts(parameter.value, parameter.standard_error)
    relative = relative_text(parameter.standard_error, parameter.value)
    if error and parameter.standard_error is not None and parameter.standard_error > abs(parameter.value):
        relative = "> 100 %"
        if parameter.status == "not identified":
            return number_text(parameter.value, digits=UNIDENTIFIED_DIGITS), "", relative
    return value, error, relative


def parameter_note(parameter: ParameterEstimate, *, said: Iterable[str] = ()) -> str:
    """Return what is to be said about one parameter, without the reasons that were `said` before."""
    notes = []
    if not parameter.free:
        notes.append("fixed")
    if parameter.at_bound is not None:
        bound = parameter.lower if parameter.at_bound == "lower" else parameter.upper
        notes.append(f"at its {parameter.at_bound} bound {bound:g}")
    if parameter.status != "ok":
        notes.append(parameter.status)
    if parameter.reason and not any(parameter.reason in sentence for sentence in said):
        notes.append(parameter.reason)
    return "; ".join(notes)


def _percent_of_fit(fit: float | None) -> str:
    """Fit in percent with the digits that differ from 100."""
    if fit is None or not math.isfinite(fit):
        return ""
    missing = 100 - fit
    if missing <= 0:
        return "100 %"
    return f"{fit:.{min(max(1 - magnitude(missing), 1), 6)}f} %"
