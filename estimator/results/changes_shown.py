"""What changed between results as text, plain data, one figure and a page. Knows the changes; computes nothing new."""

from __future__ import annotations

from typing import Any

from estimator.results.changes import Changes, Quantity
from estimator.results.numbers import magnitude, value_texts
from estimator.results.pages import asset, drawn, page
from estimator.results.result_json import json_ready
from estimator.results.svg import Bar, axis_marks, bar_limit, bar_marks, drawing, text
from estimator.results.text_table import TextTable

ROW, GAP, NAMES, VALUES, TOP = 20.0, 8.0, 190.0, 170.0, 26.0  # pixels of the figure
BARS, EDGE = 320.0, 8.0
LEAST_PERCENT, MOST_PERCENT = 1e-4, 1e4  # errors that are written without a power of ten
COLOURS = """<style>.f{fill:#fff}text{font:12px system-ui,sans-serif;fill:#222}.bar1{stroke:#0072b2;stroke-width:5}
.bar2{stroke:#0072b2;stroke-width:1.5}.point,.arrow{fill:#0072b2}.axis,.grid{stroke:#999}path{fill:none}
.differs text{fill:#b34700;font-weight:600}.differs .bar1,.differs .bar2{stroke:#d55e00}
.differs .point,.differs .arrow{fill:#d55e00}</style>"""


def changes_text(found: Changes, *, width: int | None = None) -> str:
    """Return what changed as lines: a sentence, a table (of so many characters), repeatability, notes."""
    lines = [summary(found), "", *change_table(found).lines(width)]
    if (repeatability := repeatability_table(found)).rows:
        lines += ["", *repeatability.lines(width)]
    if found.joint:
        lines += ["", *joint_lines(found)]
    if found.notes:
        lines += ["", "Not alike, or not compared:", *(f"  - {note}" for note in found.notes)]
    return "\n".join(lines) + "\n"


def summary(found: Changes) -> str:
    """Return in sentences what differs, and at which false alarm rate."""
    differing = found.differing
    reference = found.results[0]
    if differing:
        told = "; ".join(f"{name}: {', '.join(quantities)}" for name, quantities in differing.items())
        said = f"DIFFERENT from {reference}. {told}."
    else:
        said = f"NO DIFFERENCE from {reference} that the error bars allow to tell."
    beyond = f" in excess of {found.within:g} %" if found.within else ""
    return (
        f"{said}\nA quantity differs beyond {found.threshold:.2f} standard errors{beyond}: a false alarm in"
        f" {100 * found.false_alarm:g} % of such comparisons ({found.tests} tests)."
    )


def change_table(found: Changes) -> TextTable:
    """Return rows of quantity, its value, another result, whether it differs, its value, change, standard errors."""
    rows = []
    for q in found.quantities:
        for k, c in enumerate(q.changes):
            rows.append(
                [
                    q.name if k == 0 else "",
                    _value(q, found.results[0]) if k == 0 else "",
                    c.result,
                    "differs" if c.differs else "",
                    _value(q, c.result),
                    change_text(c.percent, c.percent_error),
                    f"{c.z:+.1f}",
                ]
            )
    beyond = f" beyond {found.within:g} %" if found.within else ""
    header = ["quantity", found.results[0], "against", "", "value", "change", f"std. errors{beyond}"]
    return TextTable(header, rows, (1, 4, 5, 6))


def change_text(percent: float, error: float) -> str:
    """Return a relative change with its standard error.

    >>> change_text(4.1234, 0.612)
    '+4.12 % ± 0.61 %'
    >>> change_text(-2.3e-5, 0.1)
    '+0.00 % ± 0.10 %'
    """
    if LEAST_PERCENT <= error < MOST_PERCENT:
        places = max(1 - magnitude(error), 0)
        return f"{percent:+z.{places}f} % ± {error:.{places}f} %"
    value, bar_ = value_texts(percent, error)
    return f"{'' if value.startswith('-') else '+'}{value} % ± {bar_} %"


def repeatability_table(found: Changes) -> TextTable:
    """Return how far the results scatter; no rows for two results."""
    rows = []
    for q in found.quantities:
        r = q.repeatability
        if r is not None:
            chance = f"{r.probability:.2g}" if r.probability >= 1e-4 else "< 1e-4"
            mean, deviation = value_texts(r.mean, r.deviation)
            rows.append([q.name, mean, f"± {deviation}", f"{r.percent:.2g} %", f"{r.ratio:.1f}", chance])
    header = ["repeatability", "mean", "deviation", "", "over the error bars", "by chance"]
    return TextTable(header, rows, (1, 2, 3, 4, 5))


def joint_lines(found: Changes) -> list[str]:
    """Return a sentence for each result about all its parameters at once."""
    return [
        f"{j.result}, all parameters together: chi-square {j.chi_square:.3g} with {j.degrees} degrees of freedom, by"
        f" chance in {_share(j.probability)}{'; differs' if j.differs else ''}"
        for j in found.joint
    ]


def changes_mapping(found: Changes) -> dict[str, Any]:
    """Return what changed in plain dictionaries, lists, strings and finite numbers."""
    plain: dict[str, Any] = json_ready(
        {
            "differs": bool(found.differing),
            "differing": found.differing,
            "results": found.results,
            "false_alarm": found.false_alarm,
            "within_percent": found.within,
            "threshold": found.threshold,
            "tests": found.tests,
            "quantities": {
                q.name: {
                    "unit": q.unit,
                    "kind": q.kind,
                    "values": {n: {"value": v, "standard_error": e} for n, (v, e) in q.values.items()},
                    "changes": {c.result: {k: v for k, v in vars(c).items() if k != "result"} for c in q.changes},
                    "repeatability": None if q.repeatability is None else vars(q.repeatability),
                }
                for q in found.quantities
            },
            "joint": {j.result: {k: v for k, v in vars(j).items() if k != "result"} for j in found.joint},
            "notes": found.notes,
        }
    )
    return plain


def changes_figure(found: Changes) -> str:
    """Return one drawing: every quantity of every result against the reference, on one relative axis."""
    bars = _bars(found)
    limit = bar_limit([b for b, _ in bars.values()])
    parts, y = [], TOP
    parts.append(text(NAMES, 16, f"change from {found.results[0]}, ± 1 and ± 2 standard errors"))
    for q in found.quantities:
        for k, c in enumerate(q.changes):
            entry, differs = bars[q.name, c.result]
            row = [text(EDGE, y + 14, q.name)] if k == 0 else []
            row.append(text(NAMES - 10, y + 14, c.result, anchor="end") if len(found.results) > 2 else "")
            row.append(text(NAMES + BARS + 10, y + 14, change_text(c.percent, c.percent_error)))
            inside = bar_marks(entry, limit=limit, width=BARS)
            row.append(f'<g transform="translate({NAMES:g} {y:g})">{inside}</g>')
            parts.append(f'<g class="{"differs" if differs else ""}">{"".join(row)}</g>')
            y += ROW
        y += GAP
    parts.append(f'<g transform="translate({NAMES:g} {y:g})">{axis_marks(limit, width=BARS)}</g>')
    width, height = NAMES + BARS + VALUES, y + 24
    name = f"Changes from {found.results[0]}"
    return drawing(parts, width=width, height=height, name=name, style="changes")


def changes_svg(found: Changes) -> bytes:
    """Return the drawing as a file of its own."""
    svg = changes_figure(found)
    start = svg.index(">") + 1
    head = svg[:start].replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1)
    return f'{head}{COLOURS}<rect class="f" width="100%" height="100%"/>{svg[start:]}\n'.encode()


def changes_page(found: Changes, *, command: str = "") -> str:
    """Return what changed as one HTML document that needs nothing else."""
    said, _, threshold = summary(found).partition("\n")
    return page(
        "changes.html",
        title=f"What changed from {found.results[0]}",
        style=asset("report.css"),
        said=said,
        threshold=threshold,
        mood="refused" if found.differing else "ok",
        figure=drawn(changes_figure(found)),
        changes=change_table(found),
        repeatability=repeatability_table(found),
        joint=joint_lines(found),
        notes=found.notes,
        command=command,
    )


def _bars(found: Changes) -> dict[tuple[str, str], tuple[Bar, bool]]:
    return {
        (q.name, c.result): (Bar(c.percent, c.percent_error), c.differs) for q in found.quantities for c in q.changes
    }


def _value(quantity: Quantity, result: str) -> str:
    value, error = value_texts(*quantity.values[result])
    return f"{value} ± {error} {quantity.unit}".rstrip()


def _share(probability: float) -> str:
    if probability < 1e-4:
        return "less than 0.01 % of cases"
    return f"{100 * probability:.{3 if probability > 0.995 else 2}g} % of cases"
