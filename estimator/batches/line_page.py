"""A batch as one page: pass or fail of every motor, control charts, spread, links. Knows plain rows only."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from estimator.batches.control import ControlChart, control_charts
from estimator.batches.gauge import natural, spread_table, spreads
from estimator.results.numbers import number_text, value_texts
from estimator.results.pages import asset, drawn, page
from estimator.results.svg import Box, drawing, text
from estimator.results.text_table import TextTable

MOST_CASES = 2000  # in the table; beyond, those that pass are in results.csv only
LEFT, TOP, WIDTH, HEIGHT, BELOW = 74.0, 22.0, 560.0, 120.0, 36.0  # pixels of a control chart
OUTCOMES = {  # name → (sign, what it means)
    "pass": ("✓", "ok, and all that is expected is met"),
    "undecided": ("?", "an expectation is neither met nor missed for certain"),
    "doubtful": ("~", "doubtful, expectations met"),
    "fail": ("✗", "an expectation is not met"),
    "refused": ("–", "refused: no estimate"),
    "failed": ("!", "failed: not estimated"),
}


def outcome_of(row: Mapping[str, Any]) -> str:
    """Return what became of a case in one word, the worst of its verdict and its expectations."""
    if row["verdict"] not in ("ok", "doubtful"):
        return str(row["verdict"])
    checks = set(row["checks"].values())
    if "fail" in checks:
        return "fail"
    if row["verdict"] == "doubtful":
        return "doubtful"
    return "undecided" if "undecided" in checks else "pass"


def line_page(
    rows: Sequence[Mapping[str, Any]], *, title: str, links: Mapping[str, str], renew: int = 0, command: str = ""
) -> str:
    """Return a batch as one HTML document.

    Parameters
    ----------
    rows : as `estimator.batches.case_worker.row_of` makes them
    links : case → file that shows it, relative to the page
    renew : s, after which the page reads itself again; 0: it does not
    command : that does the same batch; the page says how it makes a report of a case that has none
    """
    ordered = sorted(rows, key=lambda row: natural(str(row["case"])))
    outcomes = {str(row["case"]): outcome_of(row) for row in ordered}
    counts = Counter(outcomes.values())
    motors: dict[str, list[str]] = {}
    for row in ordered:
        motors.setdefault(str(row["motor"] or row["case"]), []).append(str(row["case"]))
    charts = control_charts(ordered)
    found = spreads(ordered)
    return page(
        "line.html",
        title=title,
        style=asset("report.css") + asset("line.css"),
        script=asset("line.js"),
        counts=[(o, *OUTCOMES[o], counts[o]) for o in OUTCOMES if counts[o]],
        grid=[
            (motor, [(case, outcomes[case], OUTCOMES[outcomes[case]][0]) for case in cases])
            for motor, cases in motors.items()
        ],
        links=links,
        renew=renew,
        command=command if any(not link.endswith("report.html") for link in links.values()) else "",
        charts=[_shown(chart) for chart in charts],
        data=drawn(_data(charts)),
        spread=spread_table(found) if found else None,
        outliers=TextTable(
            ("outlier of", "motor or case", "value", "modified z-score"),
            [(s.name, motor, f"{value:.6g} {s.unit}", f"{z:.1f}") for s in found for motor, value, z in s.outliers],
            (2, 3),
        ),
        cases=_cases(ordered, outcomes),
        left_out=max(0, len(ordered) - MOST_CASES) and sum(o == "pass" for o in outcomes.values()),
    )


def control_chart(chart: ControlChart) -> str:
    """Return one control chart: limits, means with their bars, runs."""
    bars = np.concatenate([chart.values - 2 * chart.errors, chart.values + 2 * chart.errors]).tolist()
    every = [v for _, v in chart.runs] + bars + [v for v in (chart.lower, chart.upper) if v is not None]
    low, high = min(every), max(every)
    room = 0.08 * (high - low) or 0.5 * abs(high) or 1.0
    box = Box(LEFT, TOP, WIDTH, HEIGHT, -0.5, len(chart.points) - 0.5, low - room, high + room)
    parts = [
        text(LEFT, TOP - 7, f"{chart.name} [{chart.unit or '-'}]", style="title"),
        box.grid(across=1, up=4, labels=False),
    ]
    if chart.lower is not None and chart.upper is not None:
        for limit in (chart.lower, chart.upper):
            parts.append(box.line(np.array([box.first, box.last]), np.full(2, limit), "bound"))
    parts.append(box.line(np.array([box.first, box.last]), np.full(2, chart.mean), "axis"))
    at = np.arange(len(chart.points), dtype=np.float64)
    if len(chart.runs) > len(chart.points):
        places, values = np.array([k for k, _ in chart.runs], dtype=np.float64), np.array([v for _, v in chart.runs])
        parts.append(box.dots(places, values, "measured"))
    stems = np.column_stack(
        [chart.values - 2 * chart.errors, chart.values + 2 * chart.errors, np.full(len(at), np.nan)]
    )
    parts.append(box.line(np.repeat(at, 3), stems.ravel(), "bar2"))
    parts.append(box.dots(at, chart.values, "simulated"))
    outside = np.array([p in chart.beyond for p in chart.points])
    if outside.any():
        parts.append(box.crosses(at[outside], chart.values[outside], "left-out", size=5))
    parts.append(text(LEFT, TOP + HEIGHT + 16, chart.points[0]))
    parts.append(text(LEFT + WIDTH, TOP + HEIGHT + 16, chart.points[-1], anchor="end"))
    data = f' data-left="{LEFT:g}" data-width="{WIDTH:g}"'
    name = f"Control chart of {chart.name}"
    return drawing(parts, width=LEFT + WIDTH + 10, height=TOP + HEIGHT + BELOW, name=name, style="chart", data=data)


def _shown(chart: ControlChart) -> dict[str, Any]:
    limits = ""
    if chart.lower is not None and chart.upper is not None:
        limits = f"mean {chart.mean:.5g}, limits {chart.lower:.5g} to {chart.upper:.5g} {chart.unit}".rstrip()
    return {"name": chart.name, "svg": drawn(control_chart(chart)), "limits": limits, "beyond": chart.beyond}


def _data(charts: Sequence[ControlChart]) -> str:
    """Return the charts' points as JSON that may stand in a script."""
    plain = [
        {"points": c.points, "values": [float(f"{v:.6g}") for v in c.values.tolist()], "unit": c.unit} for c in charts
    ]
    return json.dumps(plain, ensure_ascii=True).replace("<", "\\u003c")


def _cases(ordered: Sequence[Mapping[str, Any]], outcomes: Mapping[str, str]) -> dict[str, Any]:
    names = list(dict.fromkeys(name for row in ordered for name in row["parameters"]))
    units = {name: p["unit"] for row in ordered for name, p in row["parameters"].items()}
    few = len(ordered) <= MOST_CASES
    rows = []
    for row in ordered:
        case = str(row["case"])
        if not few and outcomes[case] == "pass":
            continue
        values = [_value(row["parameters"].get(name)) for name in names]
        missed = [name for name, outcome in row["checks"].items() if outcome != "pass"]
        said = [f"not met or undecided: {', '.join(missed)}"] if missed else []
        rows.append((case, str(row["motor"]), outcomes[case], values, "; ".join([*said, *row["reasons"]])))
    return {"names": [f"{name} [{units[name] or '-'}]" for name in names], "rows": rows}


def _value(p: Mapping[str, Any] | None) -> str:
    if p is None or p["value"] is None:
        return ""
    if p["status"] == "not identified":
        return "not identified"
    value, error = value_texts(p["value"], p["standard_error"])
    return f"{value} ± {error}" if error else number_text(p["value"])
