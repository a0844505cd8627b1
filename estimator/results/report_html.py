"""An estimate as one HTML file that needs nothing else: no network, no script. Knows only the result.

The verdict comes first, in words; what is needed to repeat the estimate comes last. Readable in print.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

from estimator.results.budget_table import budget_rows
from estimator.results.report import (
    SIGNAL_WORDS,
    TITLES,
    chain_rows,
    cost_lines,
    derived_rows,
    fitted_here,
    json_ready,
    meaning,
    others_text,
    parameter_rows,
    read_lines,
    signal_rows,
)
from estimator.results.result import Estimate

PROFILE_CAPTION = (
    "A rise of 1 is one standard error. Where the blue line is a parabola, the error bars hold; where it is flat to one"
    " side, the data set a limit on that side only. Far steeper with the others held: see the correlation."
)
STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1a1a1a; background: #fff;
       max-width: 70rem; margin: 2rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.6rem; margin: 0 0 1rem; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem; }
.verdict { border: 1px solid; border-left-width: .6rem; padding: .8rem 1.2rem; }
.verdict strong { font-size: 1.25rem; }
.verdict p, .verdict ul { margin: .2rem 0; }
.ok { border-color: #0072b2; } .doubtful { border-color: #e69f00; } .refused { border-color: #d55e00; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin-bottom: .8rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .25rem .9rem .25rem 0;
         border-bottom: 1px solid #ddd; }
th { font-weight: 600; white-space: nowrap; }
.number { text-align: right; white-space: nowrap; }
td:last-child:not(.number) { min-width: 8rem; }
img { max-width: 100%; height: auto; display: block; }
figure { margin: 0 0 1.2rem; }
figcaption, .small { color: #555; font-size: .9rem; }
pre, code { font: .85rem/1.4 ui-monospace, "DejaVu Sans Mono", monospace; overflow-wrap: anywhere;
            white-space: pre-wrap; }
pre { background: #f4f4f4; padding: .8rem 1rem; }
@media print { body { max-width: none; margin: 0; padding: 0; font-size: 9.5pt; } h2 { break-after: avoid; }
               figure, tr, .verdict { break-inside: avoid; } .wide { overflow: visible; }
               table, td code { font-size: 7.8pt; } th, td { padding-right: .5rem; } }
"""

FRAGMENT_STYLE = """
.fmu-estimator .verdict { border: 1px solid; border-left-width: .6rem; padding: .5rem 1rem; margin-bottom: .6rem; }
.fmu-estimator .ok { border-color: #0072b2; }
.fmu-estimator .doubtful { border-color: #e69f00; }
.fmu-estimator .refused { border-color: #d55e00; }
.fmu-estimator .number { text-align: right; }
.fmu-estimator img { max-width: 100%; }
"""


@dataclass(frozen=True)
class Pictures:
    """PNG files of the report besides those of the recordings; None where there is nothing to show.

    Attributes
    ----------
    parameters : error bars beside nominal values and bounds
    profiles : cost around every estimate
    convergence : cost over the search
    validation : (caption, PNG) of each recording that was not fitted to
    """

    parameters: bytes | None = None
    profiles: bytes | None = None
    convergence: bytes | None = None
    validation: Sequence[tuple[str, bytes]] = ()


def html_report(
    estimate: Estimate,
    *,
    figures: Sequence[tuple[str, bytes]] = (),
    pictures: Pictures | None = None,
    command: str = "",
    checksums: Mapping[str, str] | None = None,
) -> str:
    """Return the report as one HTML document.

    Parameters
    ----------
    figures : (caption, PNG) pairs
        Measured against simulated signals.
    pictures : Pictures
        The other figures.
    command : str
        The command line that repeats the estimate.
    checksums : file → SHA-256
        Of the FMU and of the data.
    """
    pictures = pictures or Pictures()
    recordings = ", ".join(comparison.name for comparison in estimate.comparisons)
    fmu = str(estimate.fmu.get("name", "")) or "FMU"
    title = f"Parameters of {fmu}" + (f" from {recordings}" if recordings else "")
    parts = [
        f"<h1>{escape(title)}</h1>",
        *(f"<p>{escape(line)}</p>" for line in read_lines(estimate)),
        _verdict(estimate),
    ]
    if estimate.parameters:
        parts += [_heading("Parameters"), _parameters(estimate)]
    if estimate.tolerances:
        parts += [_heading("Uncertainty budget"), _table(*budget_rows(estimate), right=range(2, 99))]
    if estimate.chain:
        parts += [_table(*chain_rows(estimate), right=(1, 3))]
    if estimate.derived:
        parts += [_table(*derived_rows(estimate), right=(1, 3))]
    if pictures.parameters is not None:
        caption = "Each parameter on a scale of its own; bounds are drawn where they are near."
        parts += [_figure(pictures.parameters, caption=caption, alternative="Parameters with error bars")]
    if estimate.rmse:
        parts += [_heading("How well the model explains the recording")]
        parts += [_table(*signal_rows(estimate), right=(1, 2, 3, 5)), f'<p class="small">{SIGNAL_WORDS}</p>']
    if figures and not estimate.rmse:
        parts += [_heading("Recording")]
    for caption, image in figures:
        parts += [_figure(image, caption=caption, alternative="Measured and simulated signals, and residuals")]
    if estimate.validation is not None:
        parts += [_heading("Validation: recordings that were not used for the fit"), _validation(estimate)]
        for caption, image in pictures.validation:
            parts += [_figure(image, caption=caption, alternative="Measured and simulated signals, and residuals")]
    if estimate.notes:
        parts += [_heading("Found in the data and used"), _list(estimate.notes)]
    if estimate.correlation is not None and len(estimate.correlated) > 1:
        parts += [_heading("Correlation of the estimates"), _correlation(estimate)]
    if pictures.profiles is not None:
        parts += [_heading("How the cost rises around each estimate")]
        parts += [_figure(pictures.profiles, caption=PROFILE_CAPTION, alternative="Cost profiles")]
    parts += [_heading("Cost and convergence"), *(f"<p>{escape(line)}</p>" for line in cost_lines(estimate))]
    if pictures.convergence is not None:
        caption = "Cost of the nests over the simulations of the search."
        parts += [_figure(pictures.convergence, caption=caption, alternative="Costs")]
    if estimate.failures:
        parts += [_heading("Failed simulations"), _list(estimate.failures)]
    parts += [_heading("How to repeat it"), *_repeat(estimate, command=command, checksums=checksums or {})]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width">\n<link rel="icon" href="data:,">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def html_fragment(estimate: Estimate, *, figure: bytes | None = None) -> str:
    """Return verdict and tables as a piece of HTML for a notebook, with its own look and nobody else's changed.

    Parameters
    ----------
    figure : bytes, optional
        A PNG file's content: measured against simulated signals.
    """
    parts = [_verdict(estimate)]
    if estimate.parameters:
        parts.append(_parameters(estimate))
    if estimate.chain:
        parts.append(_table(*chain_rows(estimate), right=(1, 3)))
    if estimate.derived:
        parts.append(_table(*derived_rows(estimate), right=(1, 3)))
    if estimate.rmse:
        parts.append(_table(*signal_rows(estimate), right=(1, 2, 3, 5)))
    if figure is not None:
        parts.append(_figure(figure, caption="", alternative="Measured and simulated signals, and residuals"))
    return f'<div class="fmu-estimator"><style>{FRAGMENT_STYLE}</style>' + "\n".join(parts) + "</div>"


def _verdict(estimate: Estimate) -> str:
    reasons = _list(estimate.reasons) if estimate.reasons else ""
    return (
        f'<div class="verdict {estimate.verdict}"><p><strong>{TITLES[estimate.verdict]}.</strong> '
        f"{escape(meaning(estimate))}</p>{reasons}</div>"
    )


def _parameters(estimate: Estimate) -> str:
    header, rows = parameter_rows(estimate)
    header.insert(-1, "bounds")
    for row, parameter in zip(rows, estimate.parameters.values(), strict=True):
        bounds = f"{_bound(parameter.lower)} to {_bound(parameter.upper)}" if parameter.free else ""
        row.insert(-1, bounds)
    text = "± is one standard error: what noise alone would do. A sensor's gain or offset error comes on top."
    return _table(header, rows, right=(1, 2, 3, 5, 6, 7)) + f'<p class="small">{text}</p>'


def _validation(estimate: Estimate) -> str:
    """Return RMSE and fit beside those of the recordings that were fitted."""
    assert estimate.validation is not None
    units: dict[str, str] = {}
    for comparison in (*estimate.comparisons, *estimate.validation.comparisons):
        units.update(comparison.units)
    rows = []
    for name, rmse in estimate.validation.rmse.items():
        fitted, fit = estimate.rmse.get(name, math.nan), estimate.validation.fit_percent.get(name, math.nan)
        shown = [f"{x:.4g}" if math.isfinite(x) else "-" for x in (rmse, fitted)]
        rows.append([name, shown[0], shown[1], units.get(name, ""), f"{fit:.1f} %" if math.isfinite(fit) else ""])
    text = f"{fitted_here(estimate.validation)} Where the model holds, both root mean square errors are alike."
    if estimate.validation.others is not None:
        text += f" Fitted to these alone, {escape(others_text(estimate.validation.others))}."
    header = ["output", "RMSE here", "RMSE of the fit", "unit", "fit here"]
    return _table(header, rows, right=(1, 2, 4)) + f'<p class="small">{escape(text)}</p>'


def _correlation(estimate: Estimate) -> str:
    """Return the correlation matrix as a table, shaded by size."""
    names = estimate.correlated
    lines = ["<tr><th></th>" + "".join(f'<th class="number">{escape(name)}</th>' for name in names) + "</tr>"]
    assert estimate.correlation is not None
    for name, row in zip(names, estimate.correlation.tolist(), strict=True):
        cells = []
        for value in row:
            known = value is not None and math.isfinite(value)
            shade = min(abs(value), 1.0) ** 2 * 0.45 if known else 0.0
            colour = f"rgba(0,114,178,{shade:.2f})" if known and value >= 0 else f"rgba(213,94,0,{shade:.2f})"
            text = f"{value:+.3f}" if known else "-"
            cells.append(f'<td class="number" style="background:{colour}">{text}</td>')
        lines.append(f"<tr><th>{escape(name)}</th>{''.join(cells)}</tr>")
    text = "Near ±1: the recording tells only a combination of the two, not each by itself."
    return f'<div class="wide"><table>{"".join(lines)}</table></div><p class="small">{text}</p>'


def _repeat(estimate: Estimate, *, command: str, checksums: Mapping[str, str]) -> Iterable[str]:
    if command:
        yield f"<pre>{escape(command)}</pre>"
    rows = [["seed", str(estimate.seed)], ["method", estimate.method]]
    rows += [[f"version of {name}", str(version)] for name, version in estimate.versions.items()]
    for name, value in estimate.fmu.items():
        plain = json_ready(value)
        shown = ", ".join(map(str, plain)) if isinstance(plain, list) else str(plain)
        rows.append([f"FMU {name.replace('_', ' ')}", "" if plain is None else shown])
    rows += [[f"SHA-256 of {name}", checksum] for name, checksum in checksums.items()]
    yield _table(["", ""], [row for row in rows if row[1]])


def _table(header: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[int] = ()) -> str:
    """Return a table without its empty columns; the columns in `right` are set flush right."""
    used = [k for k in range(len(header)) if any(row[k] for row in rows)]

    def line(cells: Sequence[str], tag: str) -> str:
        classes = {k: ' class="number"' if k in right else "" for k in used}
        return "<tr>" + "".join(f"<{tag}{classes[k]}>{escape(cells[k])}</{tag}>" for k in used) + "</tr>"

    lines = [line(header, "th")] if any(header) else []
    lines += [line(row, "td") for row in rows]
    return '<div class="wide"><table>\n' + "\n".join(lines) + "\n</table></div>"


def _figure(image: bytes, *, caption: str, alternative: str) -> str:
    data = base64.b64encode(image).decode()
    return (
        f'<figure><img alt="{escape(alternative)}" src="data:image/png;base64,{data}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _list(items: Iterable[str]) -> str:
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in items) + "</ul>"


def _heading(text: str) -> str:
    return f"<h2>{escape(text)}</h2>"


def _bound(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "none"
