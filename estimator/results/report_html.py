"""An estimate as one HTML file that needs nothing else: no network. Knows only the result.

The first screen holds the verdict, what was read, the parameters on one relative axis and the transient; what is
needed to repeat the estimate comes last, folded away. Light and dark; two pages in print.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from estimator.results.budget_table import budget_rows
from estimator.results.numbers import ABSENT, number_text, relative_text, value_texts
from estimator.results.page_figures import (
    SLIM,
    WIDE,
    WIDTH,
    convergence_chart,
    legend,
    profile_charts,
    recording_chart,
    transient_chart,
    whiteness_charts,
)
from estimator.results.pages import asset, drawn, page
from estimator.results.reason import Place, places_of
from estimator.results.report import (
    SIGNAL_WORDS,
    TITLES,
    chain_rows,
    cost_lines,
    derived_rows,
    estimate_texts,
    fitted_here,
    json_ready,
    meaning,
    others_text,
    parameter_note,
    parameter_rows,
    read_lines,
    signal_rows,
)
from estimator.results.residuals import recording_fits, whiteness
from estimator.results.result import Comparison, Estimate, ParameterEstimate
from estimator.results.svg import Bar, bar, bar_axis, bar_limit

MOST_CHARTS = 12  # of whole recordings
AROUND = 0.04  # of a recording: shown around the place where a reason lies
CAPTION = "{}: measured and simulated; the band around the residuals is two standard deviations of them."
PROFILE_WORDS = (
    "A rise of 1 is one standard error. Where the blue line is a parabola, the error bars hold; where it is flat to one"
    " side, the data set a limit on that side only. Far steeper with the others held: see the correlation."
)
MARK_WORDS = {"bound": "An upright line is a bound.", "nominal": "A diamond is the nominal value."}
BAR_WORDS = "± is one standard error: what noise alone does. A sensor's gain or offset error comes on top."
RESIDUAL_WORDS = (
    "Without outliers, and without the ripple and drift that were found. Of white noise 95 % of the correlations lie"
    " within the band; the blue curve is a normal distribution."
)
RIVAL_WORDS = (
    "Explanations that are nearly as likely as the estimate's, over its values: zero is the estimate. The weight is a"
    " rival's part of what the standard errors allow for. What would decide between them stands beside each."
)
Table = dict[str, Any]


@dataclass(frozen=True)
class _Row:
    """One line of a table with error bars."""

    name: str
    value: str
    error: str
    unit: str
    relative: str
    bar: str = ""
    extra: str = ""


@dataclass(frozen=True)
class _Part:
    """Some lines of such a table, under a title."""

    rows: Sequence[_Row]
    title: str = ""
    extra: bool = False

    @property
    def width(self) -> int:
        """Columns that the title spans."""
        return 7


def html_report(estimate: Estimate, *, command: str = "", checksums: Mapping[str, str] | None = None) -> str:
    """Return the report as one HTML document.

    Parameters
    ----------
    command : str
        The command line that repeats the estimate.
    checksums : file → SHA-256
        Of the FMU and of the data.
    """
    shown = [c for c in estimate.comparisons if c.measured and len(c.time) > 1]
    places = places_of(estimate.reasons)
    parts, axis = _parameters(estimate)
    return page(
        "report.html",
        title=_title(estimate),
        about=estimate.about,
        read=read_lines(estimate),
        style=asset("report.css"),
        script=asset("report.js"),
        **_verdict(estimate),
        parts=parts,
        axis=axis,
        bar_words=_bar_words(parts) if axis else "",
        transient=_transient(shown, places, fitted=bool(estimate.parameters)),
        budget=_budget(estimate),
        signals=_signals(estimate),
        records=[_record(c, estimate, places) for c in shown[:MOST_CHARTS]],
        records_not_shown=f"{len(shown) - MOST_CHARTS} more recordings have no chart here."
        if len(shown) > MOST_CHARTS
        else "",
        validation=_validation(estimate),
        across=_across(estimate),
        rivals=_rivals(estimate),
        residuals=_residuals(estimate),
        notes=estimate.notes,
        failures=estimate.failures,
        correlation=_correlation(estimate),
        profiles=[drawn(svg) for svg in profile_charts(estimate.profiles, units=_units(estimate))],
        profile_words=PROFILE_WORDS,
        full=_full(estimate),
        cost=cost_lines(estimate),
        convergence=_convergence(estimate),
        command=command,
        repeat=_repeat(estimate, checksums or {}),
    )


def html_fragment(estimate: Estimate, *, figure: bytes | None = None) -> str:
    """Return what was read, verdict and tables as HTML for a notebook, with its own look and nobody else's changed.

    Parameters
    ----------
    figure : bytes, optional
        A PNG file's content: measured against simulated signals.
    """
    tables = []
    for there, found, right in (
        (estimate.parameters, parameter_rows, (1, 3, 5, 6)),
        (estimate.chain, chain_rows, (1, 3)),
        (estimate.derived, derived_rows, (1, 3)),
        (estimate.rmse, signal_rows, (1, 2, 3, 5)),
    ):
        if there:
            tables.append((*_without_empty(*found(estimate), right=right),))
    image = "" if figure is None else base64.b64encode(figure).decode("ascii")
    return page("fragment.html", **_verdict(estimate), read=read_lines(estimate), tables=tables, image=image)


def _title(estimate: Estimate) -> str:
    fmu = str(estimate.fmu.get("name", "")) or "FMU"
    names = [comparison.name for comparison in estimate.comparisons]
    told = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return f"Parameters of {fmu}" + (f" from {told}" if told else "")


def _verdict(estimate: Estimate) -> dict[str, Any]:
    return {
        "verdict_title": TITLES[estimate.verdict],
        "meaning": meaning(estimate),
        "mood": estimate.verdict,
        "reasons": estimate.reasons,
    }


def _units(estimate: Estimate) -> dict[str, str]:
    return {name: p.unit for name, p in {**estimate.parameters, **estimate.chain}.items()}


# --- what is on the first screen ------------------------------------------------------------------------------------


def _bar_words(parts: list[_Part]) -> str:
    """Say what the bars are, and the marks beside them, where there are some."""
    bars = "".join(row.bar for part in parts for row in part.rows)
    return " ".join([BAR_WORDS, *(words for style, words in MARK_WORDS.items() if f'class="{style}"' in bars)])


def _parameters(estimate: Estimate) -> tuple[list[_Part], str]:
    """Return parameters, measurement chain and derived quantities with bars on one relative axis, and that axis."""
    bars = {name: _bar(p) for name, p in estimate.parameters.items()}
    also = {name: Bar(0.0, _percent(q.standard_error, q.value)) for name, q in estimate.derived.items()}
    drawn_bars = [b for b in (*bars.values(), *also.values()) if b is not None and b.error is not None]
    limit = bar_limit(drawn_bars)
    parts = []
    if bars:
        rows = [_estimate_row(p, bars[name], limit, estimate) for name, p in estimate.parameters.items()]
        parts.append(_Part(rows, extra=any(row.extra for row in rows)))
    if estimate.chain:
        rows = [_estimate_row(p, None, limit, estimate) for p in estimate.chain.values()]
        parts.append(_Part(rows, "measurement chain", extra=any(row.extra for row in rows)))
    if also:
        rows = []
        for name, quantity in estimate.derived.items():
            value, error = value_texts(quantity.value, quantity.standard_error)
            relative = relative_text(quantity.standard_error, quantity.value)
            svg = drawn(bar(also[name], limit=limit, name=f"{name}: ± {relative}"))
            rows.append(_Row(name.replace("_", " "), value, f"± {error}", quantity.unit, relative, svg))
        parts.append(_Part(rows, "derived quantities"))
    return parts, drawn(bar_axis(limit)) if drawn_bars else ""


def _estimate_row(p: ParameterEstimate, entry: Bar | None, limit: float, estimate: Estimate) -> _Row:
    value, error, relative = estimate_texts(p)
    notes = [f"nominal {number_text(p.nominal)}"] if p.nominal is not None else []
    notes += [note] if (note := parameter_note(p, said=estimate.reasons)) else []
    told = f"± {error}" if error else (ABSENT if p.free else "")
    svg = drawn(bar(entry, limit=limit, name=f"{p.name}: ± {relative}")) if entry else ""
    return _Row(p.name, value, told, p.unit, relative, svg, "; ".join(notes))


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


def _transient(shown: Sequence[Comparison], places: Sequence[Place], *, fitted: bool) -> Table | None:
    """Return the drawing of the first screen: the transient, or, where nothing was fitted, where the reason lies."""
    if not shown:
        return None
    where = {c.name: c for c in shown}
    at = None if fitted else next((place for place in places if place.recording in where), None)
    c = where[at.recording] if at else shown[0]
    if at is None:
        svg, slim = (transient_chart(c, width=width, places=_of(places, c)) for width in (WIDTH, SLIM))
        title = "Transient"
    else:
        whole = float(c.time[-1] - c.time[0])
        window = max(float(c.time[0]), at.start - AROUND * whole), min(float(c.time[-1]), at.end + AROUND * whole)
        svg, slim = (
            recording_chart(c, window=window, residuals=False, places=_of(places, c), width=width)
            for width in (WIDTH, SLIM)
        )
        title = "Where the reason lies"
    return {
        "svg": drawn(svg),
        "slim": drawn(slim),
        "title": title,
        "caption": c.name,
        "legend": _legend(c, places, residuals=False),
    }


def _of(places: Sequence[Place], c: Comparison) -> list[Place]:
    return [place for place in places if place.recording == c.name]


def _legend(c: Comparison, places: Sequence[Place], *, residuals: bool = True) -> list[tuple[str, str]]:
    lines = legend([c], places=bool(_of(places, c)))
    return [line for line in lines if residuals or line[0] != "taken-out"]


# --- what follows ---------------------------------------------------------------------------------------------------


def _budget(estimate: Estimate) -> Table | None:
    """Return what each tolerance adds to each uncertainty."""
    header, rows = budget_rows(estimate)
    return {"header": header, "rows": rows, "right": tuple(range(2, len(header)))} if rows else None


def _signals(estimate: Estimate) -> Table | None:
    if not estimate.rmse:
        return None
    header, rows, right = _without_empty(*signal_rows(estimate), right=(1, 2, 3, 5))
    return {"header": header, "rows": rows, "right": right, "words": SIGNAL_WORDS}


def _record(c: Comparison, estimate: Estimate, places: Sequence[Place]) -> Table:
    svg, slim = (recording_chart(c, noise=estimate.noise, places=_of(places, c), width=width) for width in (WIDE, SLIM))
    return {
        "title": c.name,
        "svg": drawn(svg),
        "slim": drawn(slim),
        "caption": CAPTION.format(c.name) if c.simulated else c.name,
        "legend": _legend(c, places),
    }


def _validation(estimate: Estimate) -> Table | None:
    """Return RMSE and fit beside those of the recordings that were fitted."""
    found = estimate.validation
    if found is None:
        return None
    units: dict[str, str] = {}
    for comparison in (*estimate.comparisons, *found.comparisons):
        units.update(comparison.units)
    rows = []
    for name, rmse in found.rmse.items():
        fitted, fit = estimate.rmse.get(name, math.nan), found.fit_percent.get(name, math.nan)
        shown = [f"{x:.4g}" if math.isfinite(x) else ABSENT for x in (rmse, fitted)]
        rows.append([name, shown[0], shown[1], units.get(name, ""), f"{fit:.1f} %" if math.isfinite(fit) else ""])
    words = f"{fitted_here(found)} Where the model holds, both root mean square errors are alike."
    if found.others is not None:
        words += f" Fitted to these alone, {others_text(found.others)}."
    return {
        "header": ["output", "RMSE here", "RMSE of the fit", "unit", "fit here"],
        "rows": rows,
        "right": (1, 2, 4),
        "words": words,
        "records": [_record(c, estimate, ()) for c in found.comparisons[:MOST_CHARTS]],
    }


def _across(estimate: Estimate) -> Table | None:
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
    parts = [
        _Part(
            [
                _estimate_row(p, None, limit, estimate)
                if p.name not in bars
                else _with_bar(_estimate_row(p, None, limit, estimate), bars[p.name], limit)
                for p in several
            ],
            name,
        )
        for name, several in groups.items()
    ]
    words = "Zero is the weighted mean of a parameter's values; bars that do not overlap differ."
    return {"parts": parts, "axis": drawn(bar_axis(limit)), "words": words}


def _rivals(estimate: Estimate) -> Table | None:
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
            svg = drawn(bar(bars[name], limit=limit, name=f"{name}: {off:+.3g} % from the estimate"))
            change = f"{off:+.2g} %" if off else relative_text(error, value)
            rows.append(_Row(name, shown, f"± {spread}" if spread else ABSENT, unit, change, svg))
        parts.append(_Part(rows, title))
    return {"parts": parts, "axis": drawn(bar_axis(limit)), "words": RIVAL_WORDS}


def _with_bar(row: _Row, entry: Bar, limit: float) -> _Row:
    svg = drawn(bar(entry, limit=limit, name=f"{row.name}: {entry.at:+.3g} % from the mean"))
    return _Row(row.name, row.value, row.error, row.unit, row.relative, svg)


def _residuals(estimate: Estimate) -> Table | None:
    charts = [(c.time[-1] - c.time[0]) / (len(c.time) - 1) for c in estimate.comparisons if len(c.time) > 1]
    found = whiteness(estimate.comparisons)
    if not found or not charts:
        return None
    fits = recording_fits(estimate.comparisons)
    several = len({f.recording for f in fits}) > 1 or any(f.left_out for f in fits)
    rows = [
        [f.recording, f.output, f"{f.rmse:.4g}", f.unit, f"{f.fit_percent:.1f} %", str(f.samples), str(f.left_out)]
        for f in fits
    ]
    return {
        "header": ["recording", "output", "RMSE", "", "fit", "samples", "outliers"],
        "rows": rows if several else [],
        "right": (2, 4, 5, 6),
        "charts": [(n, drawn(a), drawn(b)) for n, a, b in whiteness_charts(found, interval=float(charts[0]))],
        "words": RESIDUAL_WORDS,
    }


def _correlation(estimate: Estimate) -> Table | None:
    """Return the correlation matrix with a shade for each size."""
    if estimate.correlation is None or len(estimate.correlated) < 2:
        return None
    rows = []
    for name, row in zip(estimate.correlated, estimate.correlation.tolist(), strict=True):
        cells = []
        for value in row:
            known = value is not None and math.isfinite(value)
            shade = min(abs(value), 1.0) ** 2 * 0.45 if known else 0.0
            colour = f"rgba(0,114,178,{shade:.2f})" if known and value >= 0 else f"rgba(213,94,0,{shade:.2f})"
            cells.append((f"{value:+.3f}" if known else ABSENT, colour))
        rows.append((name, cells))
    return {"names": estimate.correlated, "rows": rows}


def _full(estimate: Estimate) -> Table:
    """Return every parameter with its bounds and what it sets in the FMU."""
    header, rows = parameter_rows(estimate)
    header += ["bounds", "sets in the FMU"]
    for row, p in zip(rows, estimate.parameters.values(), strict=True):
        row.append(f"{_bound(p.lower)} to {_bound(p.upper)}" if p.free else "")
        row.append(", ".join(f"{s.variable} = {s.value:.6g} {s.unit}".rstrip() for s in p.set_in_fmu))
    header, rows, right = _without_empty(header, rows, right=(1, 2, 3, 5, 6))
    return {"header": header, "rows": rows, "right": right}


def _convergence(estimate: Estimate) -> str:
    history = estimate.history
    return drawn(convergence_chart(history)) if history is not None and len(history.simulations) >= 2 else ""


def _repeat(estimate: Estimate, checksums: Mapping[str, str]) -> list[list[str]]:
    rows = [["seed", str(estimate.seed)], ["method", estimate.method]]
    rows += [[f"version of {name}", str(version)] for name, version in estimate.versions.items()]
    for name, value in estimate.fmu.items():
        plain = json_ready(value)
        shown = ", ".join(map(str, plain)) if isinstance(plain, list) else str(plain)
        rows.append([f"FMU {name.replace('_', ' ')}", "" if plain is None else shown])
    rows += [[f"SHA-256 of {name}", checksum] for name, checksum in checksums.items()]
    return [row for row in rows if row[1]]


def _without_empty(
    header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[int]
) -> tuple[list[str], list[list[str]], list[int]]:
    """Return a table without its empty columns, and which of those that are left are flush right."""
    used = [k for k in range(len(header)) if any(row[k] for row in rows)]
    return (
        [header[k] for k in used],
        [[row[k] for k in used] for row in rows],
        [n for n, k in enumerate(used) if k in right],
    )


def _bound(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
