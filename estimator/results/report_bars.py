"""Parameters with their error bars on one relative axis, as rows of a page. Knows only the result."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from estimator.results.numbers import ABSENT, number_text, relative_text, value_texts
from estimator.results.pages import drawn
from estimator.results.report_tables import estimate_texts, parameter_note
from estimator.results.result import Estimate, ParameterEstimate
from estimator.results.svg import Bar, bar, bar_axis, bar_limit

MARK_WORDS = {"bound": "An upright line is a bound.", "nominal": "A diamond is the nominal value."}
BAR_WORDS = "± is one standard error: what noise alone does. A sensor's gain or offset error comes on top."
RIVAL_WORDS = (
    "Explanations that are nearly as likely as the estimate's, over its values: zero is the estimate. The weight is a"
    " rival's part of what the standard errors allow for. What would decide between them stands beside each."
)
ACROSS_WORDS = "Zero is the weighted mean of a parameter's values; bars that do not overlap differ."


@dataclass(frozen=True)
class BarRow:
    """One line of a table with error bars."""

    name: str
    value: str
    error: str
    unit: str
    relative: str
    bar: str = ""
    note: str = ""


@dataclass(frozen=True)
class BarPart:
    """Some lines of such a table, under a title."""

    rows: Sequence[BarRow]
    title: str = ""

    @property
    def has_notes(self) -> bool:
        """Whether a line has something to say beside its bar."""
        return any(row.note for row in self.rows)


@dataclass(frozen=True)
class BarTable:
    """A table with error bars, the axis below these, and what they mean; an empty axis: there are none."""

    parts: Sequence[BarPart]
    axis: str
    words: str


def parameter_bars(estimate: Estimate) -> BarTable:
    """Return parameters, measurement chain and derived quantities with bars on one relative axis."""
    bars = {name: _bar(p) for name, p in estimate.parameters.items()}
    also = {name: Bar(0.0, _percent(q.standard_error, q.value)) for name, q in estimate.derived.items()}
    drawn_bars = [b for b in (*bars.values(), *also.values()) if b is not None and b.error is not None]
    limit = bar_limit(drawn_bars)
    parts = []
    if bars:
        rows = []
        for name, p in estimate.parameters.items():
            own = bars[name]
            svg = _svg(own, limit, f"{name}: ± {estimate_texts(p)[2]}") if own else ""
            rows.append(_row(p, svg, _note(p, estimate)))
        parts.append(BarPart(rows))
    if estimate.chain:
        parts.append(BarPart([_row(p, note=_note(p, estimate)) for p in estimate.chain.values()], "measurement chain"))
    if also:
        rows = []
        for name, quantity in estimate.derived.items():
            value, error = value_texts(quantity.value, quantity.standard_error)
            relative = relative_text(quantity.standard_error, quantity.value)
            svg = _svg(also[name], limit, f"{name}: ± {relative}")
            rows.append(BarRow(name.replace("_", " "), value, f"± {error}", quantity.unit, relative, svg))
        parts.append(BarPart(rows, "derived quantities"))
    shown = "".join(row.bar for part in parts for row in part.rows)
    words = [BAR_WORDS, *(words for style, words in MARK_WORDS.items() if f'class="{style}"' in shown)]
    return BarTable(parts, drawn(bar_axis(limit)) if drawn_bars else "", " ".join(words))


def bars_across_recordings(estimate: Estimate) -> BarTable | None:
    """Return the parameters that have a value for each recording, against their weighted means."""
    names = [c.name for c in estimate.comparisons]
    groups: dict[str, list[ParameterEstimate]] = {}
    for name, p in estimate.parameters.items():
        own = next((r for r in names if name.endswith(f" {r}")), None)
        if own is not None and p.standard_error:
            groups.setdefault(name.removesuffix(f" {own}"), []).append(p)
    groups = {name: several for name, several in groups.items() if len(several) > 1}
    if not groups:
        return None
    bars: dict[str, Bar] = {}
    for several in groups.values():
        weights = [1 / (p.standard_error or math.inf) ** 2 for p in several]
        mean = sum(w * p.value for w, p in zip(weights, several, strict=True)) / sum(weights)
        for p in several:
            if mean:
                bars[p.name] = Bar(100 * (p.value - mean) / abs(mean), _percent(p.standard_error, mean))
    limit = bar_limit(list(bars.values()))
    parts = []
    for name, several in groups.items():
        rows = []
        for p in several:
            off = bars.get(p.name)
            rows.append(_row(p, _svg(off, limit, f"{p.name}: {off.at:+.3g} % from the mean") if off else ""))
        parts.append(BarPart(rows, name))
    return BarTable(parts, drawn(bar_axis(limit)), ACROSS_WORDS)


def rival_bars(estimate: Estimate) -> BarTable | None:
    """Return the estimate and each rival's parameters, on one axis relative to the estimate's values."""
    if not estimate.rivals:
        return None
    own = {name: p for name, p in estimate.parameters.items() if p.free and math.isfinite(p.value) and p.value != 0}
    titled = [("the estimate", {name: (p.value, p.standard_error, p.unit) for name, p in own.items()})]
    for rival in estimate.rivals:
        values = {n: (p.value, p.standard_error, p.unit) for n, p in rival.parameters.items() if n in own}
        titled.append((f"{rival.what} (weight {100 * rival.weight:.2g} %): {rival.decided_by}", values))
    groups = []
    for title, values in titled:
        bars = {
            name: Bar(100 * (value - own[name].value) / abs(own[name].value), _percent(error, own[name].value))
            for name, (value, error, _) in values.items()
        }
        groups.append((title, values, bars))
    limit = bar_limit([entry for *_, bars in groups for entry in bars.values()])
    parts = []
    for title, values, bars in groups:
        rows = []
        for name, (value, error, unit) in values.items():
            shown, spread = value_texts(value, error)
            off = bars[name].at
            svg = _svg(bars[name], limit, f"{name}: {off:+.3g} % from the estimate")
            change = f"{off:+.2g} %" if off else relative_text(error, value)
            rows.append(BarRow(name, shown, f"± {spread}" if spread else ABSENT, unit, change, svg))
        parts.append(BarPart(rows, title))
    return BarTable(parts, drawn(bar_axis(limit)), RIVAL_WORDS)


def _row(p: ParameterEstimate, svg: str = "", note: str = "") -> BarRow:
    value, error, relative = estimate_texts(p)
    return BarRow(p.name, value, f"± {error}" if error else (ABSENT if p.free else ""), p.unit, relative, svg, note)


def _note(p: ParameterEstimate, estimate: Estimate) -> str:
    notes = [f"nominal {number_text(p.nominal)}"] if p.nominal is not None else []
    notes += [note] if (note := parameter_note(p, said=estimate.reasons)) else []
    return "; ".join(notes)


def _svg(entry: Bar, limit: float, name: str) -> str:
    return drawn(bar(entry, limit=limit, name=name))


def _bar(p: ParameterEstimate) -> Bar | None:
    """Return a parameter's bar around itself; None for one that has neither an error nor a nominal value."""
    if not p.free or not p.is_told or not math.isfinite(p.value) or p.value == 0:
        return None
    error = _percent(p.standard_error, p.value)
    mark = None if p.nominal is None else 100 * (p.nominal - p.value) / abs(p.value)
    if error is None and mark is None:
        return None
    return Bar(0.0, error, mark, tuple(100 * (b - p.value) / abs(p.value) for b in (p.lower, p.upper)))


def _percent(error: float | None, value: float) -> float | None:
    known = error is not None and math.isfinite(error) and math.isfinite(value) and value != 0
    return 100 * error / abs(value) if known and error is not None else None
