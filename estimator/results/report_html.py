"""An estimate as one HTML file that needs nothing else: no network. Knows only the result.

The first screen holds the verdict, what was read, the parameters on one relative axis and the transient; what is
needed to repeat the estimate comes last, folded away. Light and dark; two pages in print.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from typing import Any

from estimator.results.budget_table import budget_table
from estimator.results.numbers import ABSENT
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
from estimator.results.report_bars import bars_across_recordings, parameter_bars, rival_bars
from estimator.results.report_sentences import TITLES, cost_lines, fitted_here, meaning, others_text, read_lines
from estimator.results.report_tables import SIGNAL_WORDS, chain_table, derived_table, parameter_table, signal_table
from estimator.results.residuals import recording_fits, whiteness
from estimator.results.result import Comparison, Estimate
from estimator.results.result_json import json_ready
from estimator.results.text_table import TextTable

MOST_CHARTS = 12  # of whole recordings
AROUND = 0.04  # of a recording: shown around the place where a reason lies
CAPTION = "{}: measured and simulated; the band around the residuals is two standard deviations of them."
PROFILE_WORDS = (
    "A rise of 1 is one standard error. Where the blue line is a parabola, the error bars hold; where it is flat to one"
    " side, the data set a limit on that side only. Far steeper with the others held: see the correlation."
)
RESIDUAL_WORDS = (
    "Without outliers, and without the ripple and drift that were found. Of white noise 95 % of the correlations lie"
    " within the band; the blue curve is a normal distribution."
)
Shown = dict[str, Any]  # what a template takes


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
    return page(
        "report.html",
        title=_title(estimate),
        about=estimate.about,
        read=read_lines(estimate),
        style=asset("report.css"),
        script=asset("report.js"),
        **_verdict(estimate),
        parameters=parameter_bars(estimate),
        transient=_transient(shown, places, fitted=bool(estimate.parameters)),
        budget=budget_table(estimate),
        signals=signal_table(estimate).without_empty(),
        signal_words=SIGNAL_WORDS,
        records=[_record(c, estimate, places) for c in shown[:MOST_CHARTS]],
        records_not_shown=f"{len(shown) - MOST_CHARTS} more recordings have no chart here."
        if len(shown) > MOST_CHARTS
        else "",
        validation=_validation(estimate),
        across=bars_across_recordings(estimate),
        rivals=rival_bars(estimate),
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
        repeat=TextTable(("", ""), _repeat(estimate, checksums or {})),
    )


def html_fragment(estimate: Estimate, *, figure: bytes | None = None) -> str:
    """Return what was read, verdict and tables as HTML for a notebook, with its own look and nobody else's changed.

    Parameters
    ----------
    figure : bytes, optional
        A PNG file's content: measured against simulated signals.
    """
    every = (parameter_table(estimate), chain_table(estimate), derived_table(estimate), signal_table(estimate))
    tables = [table.without_empty() for table in every if table.rows]
    image = "" if figure is None else base64.b64encode(figure).decode("ascii")
    return page(
        "fragment.html",
        **_verdict(estimate),
        read=read_lines(estimate),
        tables=tables,
        image=image,
    )


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


def _transient(shown: Sequence[Comparison], places: Sequence[Place], *, fitted: bool) -> Shown | None:
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


def _record(c: Comparison, estimate: Estimate, places: Sequence[Place]) -> Shown:
    svg, slim = (recording_chart(c, noise=estimate.noise, places=_of(places, c), width=width) for width in (WIDE, SLIM))
    return {
        "title": c.name,
        "svg": drawn(svg),
        "slim": drawn(slim),
        "caption": CAPTION.format(c.name) if c.simulated else c.name,
        "legend": _legend(c, places),
    }


def _validation(estimate: Estimate) -> Shown | None:
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
        "table": TextTable(["output", "RMSE here", "RMSE of the fit", "unit", "fit here"], rows, (1, 2, 4)),
        "words": words,
        "records": [_record(c, estimate, ()) for c in found.comparisons[:MOST_CHARTS]],
    }


def _residuals(estimate: Estimate) -> Shown | None:
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
        "table": TextTable(
            ["recording", "output", "RMSE", "", "fit", "samples", "outliers"], rows if several else [], (2, 4, 5, 6)
        ),
        "charts": [(n, drawn(a), drawn(b)) for n, a, b in whiteness_charts(found, interval=float(charts[0]))],
        "words": RESIDUAL_WORDS,
    }


def _correlation(estimate: Estimate) -> Shown | None:
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


def _full(estimate: Estimate) -> TextTable:
    """Return every parameter with its bounds and what it sets in the FMU."""
    told = parameter_table(estimate)
    rows = []
    for row, p in zip(told.rows, estimate.parameters.values(), strict=True):
        bounds = f"{_bound(p.lower)} to {_bound(p.upper)}" if p.free else ""
        rows.append([*row, bounds, ", ".join(f"{s.variable} = {s.value:.6g} {s.unit}".rstrip() for s in p.set_in_fmu)])
    return TextTable([*told.header, "bounds", "sets in the FMU"], rows, (1, 2, 3, 5, 6)).without_empty()


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


def _bound(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
