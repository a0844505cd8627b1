"""An estimate as text for a person and as JSON for a program. Knows only the result; computes nothing new."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator.results.budget_table import budget_line, budget_mapping
from estimator.results.result import Estimate, ParameterEstimate

VALUE_DIGITS = 9  # at most: beyond that a noise-free fit prints its rounding errors
UNKNOWN_ERROR_DIGITS = 6  # of a value whose standard error is not known
ABSENT = "-"

VERDICTS = {
    "ok": "OK: the recording tells these parameters, and the model explains the recording.",
    "doubtful": "DOUBTFUL: the best fit is below, but read the reasons before using it.",
    "refused": "REFUSED: no estimate that could be relied on.",
}


def text_report(estimate: Estimate) -> str:
    """Return the result as aligned lines: verdict and reasons first, then values, fit and cost."""
    lines = [VERDICTS[estimate.verdict], *(f"  - {reason}" for reason in estimate.reasons)]
    if estimate.parameters:
        lines += ["", *table(*parameter_rows(estimate), right=(1, 3, 5, 6))]
    if told := budget_line(estimate):
        lines += ["", told]
    if estimate.chain:
        lines += ["", *table(*chain_rows(estimate), right=(1, 3))]
    if estimate.derived:
        lines += ["", *table(*derived_rows(estimate), right=(1, 3))]
    if estimate.rmse:
        lines += ["", *table(*signal_rows(estimate), right=(1, 3))]
    if estimate.validation is not None:
        lines += ["", "Validation, on recordings that it was not fitted to:", *validation_lines(estimate)]
    if estimate.notes:
        lines += ["", "Found in the data and used:", *(f"  - {note}" for note in estimate.notes)]
    if estimate.failures:
        lines += ["", "Failed simulations:", *(f"  - {failure}" for failure in estimate.failures)]
    lines += ["", *cost_lines(estimate)]
    return "\n".join(lines) + "\n"


def parameter_rows(estimate: Estimate) -> tuple[list[str], list[list[str]]]:
    """Return header and rows: name, value, ± standard error, percent, unit, nominal, deviation, note.

    The columns of the nominal values are left empty (and dropped by `table`) when no nominal value is known.
    """
    return _estimate_rows("parameter", estimate.parameters, said=estimate.reasons)


def chain_rows(estimate: Estimate) -> tuple[list[str], list[list[str]]]:
    """Return header and rows of what was estimated of the measurement chain, as `parameter_rows`."""
    return _estimate_rows("measurement", estimate.chain, said=estimate.reasons)


def _estimate_rows(
    title: str, parameters: Mapping[str, ParameterEstimate], *, said: Iterable[str]
) -> tuple[list[str], list[list[str]]]:
    header = [title, "estimate", "± std. error", "", "unit", "nominal", "deviation", "note"]
    rows = []
    for name, parameter in parameters.items():
        useless = parameter.standard_error is not None and parameter.standard_error > abs(parameter.value)
        value, error = value_texts(parameter.value, None if useless else parameter.standard_error)
        nominal = parameter.nominal
        rows.append(
            [
                name,
                value,
                f"± {error}" if error else (ABSENT if parameter.free else ""),
                "> 100 %" if useless else relative_text(parameter.standard_error, parameter.value),
                parameter.unit,
                "" if nominal is None else number_text(nominal),
                "" if nominal is None else deviation_text(parameter.value, nominal),
                parameter_note(parameter, said=said),
            ]
        )
    return header, rows


def derived_rows(estimate: Estimate) -> tuple[list[str], list[list[str]]]:
    """Return header and rows: what follows from the parameters, ± standard error, percent, unit."""
    rows = []
    for name, quantity in estimate.derived.items():
        value, error = value_texts(quantity.value, quantity.standard_error)
        relative = relative_text(quantity.standard_error, quantity.value)
        rows.append([name.replace("_", " "), value, f"± {error}", relative, quantity.unit])
    return ["it follows", "value", "± std. error", "", "unit"], rows


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


def signal_rows(estimate: Estimate) -> tuple[list[str], list[list[str]]]:
    """Return header and rows: output, RMSE, its unit, fit, noise."""
    units: dict[str, str] = {}
    for comparison in estimate.comparisons:
        units.update(comparison.units)
    rows = []
    for name, rmse in estimate.rmse.items():
        unit = units.get(name, "")
        noise = estimate.noise.get(name)
        rows.append(
            [
                name,
                _finite_text(rmse, ".4g"),
                unit,
                _percent_of_fit(estimate.fit_percent.get(name)),
                "" if noise is None else f"{_finite_text(noise, '.3g')} {unit}".rstrip(),
            ]
        )
    return ["output", "RMSE", "", "fit", "noise, estimated"], rows


def validation_lines(estimate: Estimate) -> list[str]:
    """Return a line an output: its RMSE on the validation's recordings beside that of the fit."""
    assert estimate.validation is not None
    lines = []
    for name, rmse in estimate.validation.rmse.items():
        unit = next((c.units[name] for c in estimate.validation.comparisons if name in c.units), "")
        shown = f"  {name}  RMSE {_finite_text(rmse, '.4g')} {unit}".rstrip()
        fitted = _finite_text(estimate.rmse.get(name, math.nan), ".4g")
        lines.append(f"{shown} ({fitted} where it was fitted)")
    if estimate.validation.chain:
        own = ", ".join(f"{name} {value:.4g}" for name, value in estimate.validation.chain.items())
        lines.append(f"  their own delays and offsets were fitted: {own}")
    return lines


def cost_lines(estimate: Estimate) -> list[str]:
    """Return sentences about what the estimate cost and how it was made."""
    phases = ", ".join(f"{count} {phase}" for phase, count in estimate.simulations_by_phase.items() if count)
    fmu = str(estimate.fmu.get("name", "")) or "unknown FMU"
    kind, restart = estimate.fmu.get("kind"), estimate.fmu.get("restart")
    told = [f"FMI {version}"] if (version := estimate.fmu.get("fmi_version")) else []
    told += ["model exchange"] if kind == "model-exchange" else []
    told += [f"restarted by {restart}"] if restart not in (None, "reset") else []
    workers = f"{estimate.workers} worker{'' if estimate.workers == 1 else 's'}"
    return [
        f"{_count(estimate.simulations, 'simulation')}{f' ({phases})' if phases else ''}, "
        f"{estimate.failed_simulations} failed, {_count(estimate.steps, 'step')}, "
        f"{estimate.seconds:.2f} s, {workers}",
        f"method {estimate.method}, seed {estimate.seed}, FMU {fmu}" + (f" ({', '.join(told)})" if told else ""),
    ]


def to_json(estimate: Estimate) -> str:
    """Return the result as one JSON object (ASCII text with a line end); NaN and infinity become null."""
    return json.dumps(to_mapping(estimate), indent=2, allow_nan=False) + "\n"


def refusal_json(reason: str, *, method: str | None, seed: int | None) -> str:
    """Return the JSON object of an estimation that failed before it had any result."""
    failed = Estimate(
        verdict="refused",
        reasons=(reason,),
        parameters={},
        method=method or "cuckoo",
        seed=1 if seed is None else seed,
        simulations=0,
        simulations_by_phase={},
        failed_simulations=0,
        steps=0,
        seconds=0.0,
        fmu={},
        versions={},
    )
    return to_json(failed)


def to_mapping(estimate: Estimate) -> dict[str, Any]:
    """Return the result in plain dictionaries, lists, strings and finite numbers."""
    correlation: dict[str, dict[str, Any]] = {}
    if estimate.correlation is not None:
        for name, row in zip(estimate.correlated, estimate.correlation.tolist(), strict=True):
            correlation[name] = dict(zip(estimate.correlated, row, strict=True))
    mapping = {
        "verdict": estimate.verdict,
        "reasons": estimate.reasons,
        "notes": estimate.notes,
        "parameters": {name: _parameter_mapping(p) for name, p in estimate.parameters.items()},
        "measurement_chain": {name: _parameter_mapping(p) for name, p in estimate.chain.items()},
        "sensors": estimate.sensors,
        "recordings": estimate.recordings,
        "derived": {
            name: {"value": q.value, "standard_error": q.standard_error, "uncertainty": q.uncertainty, "unit": q.unit}
            for name, q in estimate.derived.items()
        },
        **budget_mapping(estimate),
        "correlation": correlation,
        "information": estimate.information,
        "rmse": estimate.rmse,
        "fit_percent": estimate.fit_percent,
        "noise": estimate.noise,
        "validation": None
        if estimate.validation is None
        else {
            "recordings": [c.name for c in estimate.validation.comparisons],
            "rmse": estimate.validation.rmse,
            "fit_percent": estimate.validation.fit_percent,
            "measurement_chain": estimate.validation.chain,
        },
        "simulations": estimate.simulations,
        "simulations_by_phase": estimate.simulations_by_phase,
        "failed_simulations": estimate.failed_simulations,
        "failures": estimate.failures,
        "steps": estimate.steps,
        "seconds": estimate.seconds,
        "seed": estimate.seed,
        "method": estimate.method,
        "workers": estimate.workers,
        "fmu": estimate.fmu,
        "versions": estimate.versions,
    }
    plain: dict[str, Any] = json_ready(mapping)
    return plain


def json_ready(thing: Any) -> Any:
    """Return `thing` in what JSON knows; NaN and infinity become None, anything unknown its text."""
    if thing is None or isinstance(thing, (str, bool)):
        return str(thing) if isinstance(thing, str) else thing
    if isinstance(thing, Mapping):
        return {str(key): json_ready(value) for key, value in thing.items()}
    if hasattr(thing, "tolist"):  # numpy scalar or array
        return json_ready(thing.tolist())
    if isinstance(thing, int):
        return int(thing)
    if isinstance(thing, float):
        return float(thing) if math.isfinite(thing) else None
    if isinstance(thing, (list, tuple, set, frozenset)):
        return [json_ready(item) for item in thing]
    return str(thing)


def value_texts(value: float, standard_error: float | None) -> tuple[str, str]:
    """Return value and standard error as text, the error with two digits and the value to the same place.

    The error's text is empty when it is not known.

    >>> value_texts(3.13712, 0.00234)
    ('3.1371', '0.0023')
    >>> value_texts(9.0012e-6, 2.5e-9)
    ('9.0012e-06', '2.5e-09')
    """
    if not math.isfinite(value):
        return ABSENT, ""
    if standard_error is None or not math.isfinite(standard_error) or standard_error < 0:
        return number_text(value), ""
    magnitude = _magnitude(value)
    place = _magnitude(float(f"{standard_error:.1e}")) - 1 if standard_error > 0 else -math.inf
    digits = int(min(max(magnitude - place, 0), VALUE_DIGITS - 1))  # after the first one
    if _scientific(value):
        return f"{value:.{digits}e}", f"{standard_error:.1e}"
    decimals = max(digits - magnitude, 0) if place < 0 else 0
    shown = f"{value:.{decimals}f}"
    if -8 <= place <= 2 and decimals >= -place:
        return shown, f"{standard_error:.{max(-int(place), 0)}f}"
    return shown, f"{standard_error:.1e}"


def number_text(value: float, *, digits: int = UNKNOWN_ERROR_DIGITS) -> str:
    """Return a number with at most so many digits, without trailing zeros, in the notation of `value_texts`.

    >>> number_text(1.69e-4)
    '1.69e-04'
    """
    if not _scientific(value):
        return f"{value:.{digits}g}"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{exponent}"


def relative_text(standard_error: float | None, value: float) -> str:
    """Return ``"0.12 %"``, empty when it cannot be said."""
    if standard_error is None or not math.isfinite(standard_error) or not math.isfinite(value) or value == 0:
        return ""
    percent = 100 * standard_error / abs(value)
    return (f"{percent:.2g} %" if 1e-3 <= percent < 1e3 else f"{percent:.0e} %") if percent else "0 %"


def deviation_text(value: float, nominal: float) -> str:
    """Return ``"+0.12 %"``, the deviation of a value from its nominal one."""
    if not math.isfinite(value) or not math.isfinite(nominal) or nominal == 0:
        return ""
    percent = 100 * (value - nominal) / abs(nominal)
    if percent == 0:
        return "0 %"
    return f"{percent:+.2f} %" if 0.01 <= abs(percent) < 1000 else f"{percent:+.1g} %"


def table(header: Sequence[str], rows: Iterable[Sequence[str]], *, right: Sequence[int] = ()) -> list[str]:
    """Return aligned lines; empty columns are dropped, the columns in `right` are set flush right."""
    rows = [list(row) for row in rows]
    used = [k for k in range(len(header)) if any(row[k] for row in rows)]
    lines = []
    widths = {k: max(len(row[k]) for row in [list(header), *rows]) for k in used}
    for row in [list(header), *rows]:
        cells = [row[k].rjust(widths[k]) if k in right else row[k].ljust(widths[k]) for k in used]
        lines.append("  ".join(cells).rstrip())
    return lines


def _parameter_mapping(parameter: ParameterEstimate) -> dict[str, Any]:
    return {
        "value": parameter.value,
        "standard_error": parameter.standard_error,
        "uncertainty": parameter.uncertainty,
        "repeatability": parameter.repeatability,
        "unit": parameter.unit,
        "at_bound": parameter.at_bound,
        "status": parameter.status,
        "reason": parameter.reason,
        "lower": parameter.lower,
        "upper": parameter.upper,
        "free": parameter.free,
        "nominal": parameter.nominal,
        "variables": {s.variable: {"value": s.value, "unit": s.unit, "type": s.type} for s in parameter.set_in_fmu},
    }


def _scientific(value: float) -> bool:
    """Whether a value is written with a power of ten."""
    return math.isfinite(value) and not -3 <= _magnitude(value) <= 5


def _magnitude(value: float) -> int:
    """Power of ten of the first digit; 0 for 0."""
    return int(f"{abs(value):e}".partition("e")[2]) if value else 0


def _finite_text(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ABSENT


def _percent_of_fit(fit: float | None) -> str:
    """Fit in percent with the digits that differ from 100."""
    if fit is None or not math.isfinite(fit):
        return ""
    missing = 100 - fit
    if missing <= 0:
        return "100 %"
    return f"{fit:.{min(max(1 - _magnitude(missing), 1), 6)}f} %"


def _count(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'' if number == 1 else 's'}".replace(",", " ")
