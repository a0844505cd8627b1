"""The budget of an estimate's uncertainties as a table, a line and plain data. Knows only the result."""

from __future__ import annotations

import math
from typing import Any

from estimator.results.result import Estimate
from estimator.results.text_table import TextTable

STATISTICAL = "noise and runs"


def budget_table(estimate: Estimate) -> TextTable:
    """Return rows of a source, how it was given, its part of each parameter's uncertainty; last the whole.

    No rows where no tolerance is given.
    """
    parameters = {n: p for n, p in estimate.parameters.items() if p.free and p.budget}
    header = ["uncertainty from", "given", *parameters]
    if not parameters:
        return TextTable(header, [])
    rows = [[STATISTICAL, "", *(_percent(p.standard_error, p.value) for p in parameters.values())]]
    for source, given in estimate.tolerances.items():
        parts = (_percent(p.budget.get(source, 0.0), p.value) for p in parameters.values())
        rows.append([source, f"{given.given}, {given.distribution}", *parts])
    rows.append(["combined", "", *(_percent(p.uncertainty, p.value) for p in parameters.values())])
    return TextTable(header, rows, range(2, len(header)))


def budget_line(estimate: Estimate) -> str:
    """Return the combined standard uncertainties in one line; "" where no tolerance is given."""
    rows = budget_table(estimate).rows
    if not rows:
        return ""
    names = [n for n, p in estimate.parameters.items() if p.free and p.budget]
    whole = ", ".join(f"{name} {part or 'not known'}" for name, part in zip(names, rows[-1][2:], strict=True))
    return f"With {', '.join(estimate.tolerances)}, the standard uncertainties are: {whole}"


def budget_mapping(estimate: Estimate) -> dict[str, Any]:
    """Return parameter → source → part of its uncertainty, in its unit, and what the sources are."""
    return {
        "budget": {n: {s: abs(d) for s, d in p.budget.items()} for n, p in estimate.parameters.items() if p.budget},
        "tolerance": {
            source: {
                "given": t.given,
                "distribution": t.distribution,
                "standard_uncertainty": t.value,
                "unit": t.unit,
                "left": t.left,
                "shift": {n: p.budget[source] for n, p in estimate.parameters.items() if source in p.budget},
            }
            for source, t in estimate.tolerances.items()
        },
    }


def _percent(part: float | None, value: float) -> str:
    if part is None or not math.isfinite(part) or value == 0:
        return ""
    percent = 100 * abs(part / value)
    return f"{percent:.2g} %" if percent >= 1e-3 else "0 %"
