"""An estimate as text for a person and as JSON for a program. Knows only the result; computes nothing new."""

from __future__ import annotations

import json
import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from estimator.conventions import NUMERICAL
from estimator.results.budget_table import budget_line, budget_mapping
from estimator.results.numbers import ABSENT, deviation_text, magnitude, number_text, relative_text, value_texts
from estimator.results.reason import places_of
from estimator.results.result import Estimate, NotVisible, OtherValues, ParameterEstimate, Rival, Validation, Verdict

TITLES: Mapping[Verdict, str] = {"ok": "OK", "doubtful": "Doubtful", "refused": "Refused"}
MEANINGS: Mapping[Verdict, str] = {
    "ok": "Every free parameter is identified",
    "doubtful": "An estimate with known weaknesses; read the reasons before using it.",
    "refused": "No estimate that could be relied on.",
}
SMALL = "the residuals are as small as the noise"
ALIKE = 1.2  # residuals over noise: up to that they are called as small
READ = "Read:"
REST = "in the report that -o DIR writes, and with --json"  # where what a screen leaves out stands
SIGNAL_WORDS = (
    "RMSE: measured minus simulated, all samples. Residual: its standard deviation without outliers, without samples of"
    " a sensor that stands still, and without the ripple and drift that were found. Noise: by the recording alone, at"
    " rest or from sample to sample; of noise that grows with the motion or wanders it is less than the residual, of"
    " rounded samples it may be more."
)
UNIDENTIFIED_DIGITS = 3
FEWEST = 3  # reasons, and recordings read, that a screen shows, however many there are


def meaning(estimate: Estimate) -> str:
    """Return what the verdict means, in a sentence or two; of residuals no other than the table of the fit shows."""
    if estimate.verdict != "ok":
        return MEANINGS[estimate.verdict]
    free = [p for p in estimate.parameters.values() if p.free]
    larger = _above_sample_noise(estimate)
    if free and all(p.standard_error is None for p in free):
        told = f"the residuals pass as noise ({larger})" if larger else SMALL
        return f"{told[0].upper()}{told[1:]}; this method gives no standard errors."
    if not larger:
        return f"{MEANINGS['ok']}, and {SMALL}.{_guessed_speed(estimate)}"
    return (
        f"{MEANINGS['ok']}, and the residuals pass as noise that grows with the motion or"
        f" wanders ({larger}); the standard errors hold it.{_guessed_speed(estimate)}"
    )


def _above_sample_noise(estimate: Estimate) -> str:
    """Say how much larger the residuals are than the noise that the recording alone shows; "" where they are not.

    Of a simulation's own output neither is any noise.
    """
    times = []
    for name, rmse in estimate.rmse.items():
        shown = estimate.sample_noise.get(name, math.nan)
        found = estimate.noise.get(name, rmse)
        is_exact = 100 - estimate.fit_percent.get(name, math.nan) < 100 * NUMERICAL
        if found > ALIKE * shown and not is_exact:
            size = f"{number_text(found / shown, digits=2)} times" if shown else "far above"
            times.append(f"those of {name} {size}")
    if not times:
        return ""
    return f"{', '.join(times)} the noise that the recording alone shows, at rest or from sample to sample"


def _guessed_speed(estimate: Estimate) -> str:
    """Say what depends on the unit of a speed or angle that nobody said: any unit fits as well."""
    for read in estimate.read:
        for signal, told in read.get("signals", {}).items():
            names = [n for n in ("K", "J", "B") if n in estimate.parameters]
            if names and signal in ("w", "angle") and told["unit_from"] == "name":
                return f" {', '.join(names)} hold if {told['column']!r} is in {told['unit']}, which nobody said."
    return ""


def text_report(estimate: Estimate, *, width: int | None = None, lines: int | None = None, rest: str = REST) -> str:
    """Return the result as aligned lines: what was read, verdict and reasons, then values, fit and cost.

    Parameters
    ----------
    width : int, optional
        Sentences are broken to so many characters; a table that is wider goes on below itself.
    lines : int, optional
        Lines of the screen: notes, then what is derived, then what was read of further recordings, then reasons are
        left out until it fits.
    rest : str
        Where what is left out can be read.
    """
    blocks = _blocks(estimate, width)
    if lines is None:
        return _joined(blocks, width) + "\n"
    for kind, least in (("notes", 0), ("failures", 0), ("derived", 0), ("read", FEWEST), ("reasons", FEWEST)):
        excess = _height(blocks, width) - lines
        if excess <= 0:
            break
        blocks = [b.shortened(excess, width=width, least=least, rest=rest) if b.kind == kind else b for b in blocks]
    return _joined(blocks, width) + "\n"


@dataclass(frozen=True)
class _Block:
    """A part of the text: a title, then a table's lines or a list of sentences."""

    kind: str
    title: str
    items: tuple[str, ...]
    rows: int = 0  # of a table
    is_list: bool = True
    left_out: str = ""

    def lines(self, width: int | None) -> list[str]:
        found = _wrapped(self.title, width) if self.title else []
        for item in self.items:
            found += _wrapped(item, width, first="  - ", other="    ") if self.is_list else [item]
        return found + (_wrapped(self.left_out, width, first="  ") if self.left_out else [])

    def shortened(self, excess: int, *, width: int | None, least: int, rest: str) -> _Block:
        """Return the block so many lines shorter, or as short as it may be, and where the rest stands."""
        if not self.is_list:
            return replace(self, items=(), title="", left_out=f"{self.rows} derived quantities: {rest}")
        goal = len(self.lines(width)) - excess
        short = self
        for kept in range(len(self.items) - 1, least - 1, -1):
            told = f"… {len(self.items) - kept} more: {rest}"
            if kept == 0:
                short = replace(
                    self, title="", items=(), left_out=f"{self.title} {_count(len(self.items), 'note')}, {rest}"
                )
            else:
                short = replace(self, items=self.items[:kept], left_out=told)
            if len(short.lines(width)) <= goal:
                break
        return short


def _blocks(estimate: Estimate, width: int | None) -> list[_Block]:
    """Return the parts of the text, in their order."""

    def rows(kind: str, found: tuple[list[str], list[list[str]]], right: Sequence[int]) -> _Block:
        return _Block(kind, "", tuple(table(*found, right=right, width=width)), len(found[1]), is_list=False)

    verdict = f"{TITLES[estimate.verdict].upper()}: {meaning(estimate)}"
    blocks = [_Block("reasons", verdict, estimate.reasons)]
    if read := [*read_lines(estimate), *([about_line(estimate)] if estimate.about else [])]:
        blocks.insert(0, _Block("read", read[0], ()) if len(read) == 1 else _Block("read", READ, tuple(read)))
    if estimate.parameters:
        blocks.append(rows("parameters", parameter_rows(estimate), (1, 3, 5, 6)))
    if told := budget_line(estimate):
        blocks.append(_Block("budget", told, ()))
    if estimate.chain:
        blocks.append(rows("chain", chain_rows(estimate), (1, 3)))
    if estimate.derived:
        blocks.append(rows("derived", derived_rows(estimate), (1, 3)))
    if estimate.rmse:
        blocks.append(rows("signals", signal_rows(estimate), (1, 2, 3, 5)))
    if estimate.validation is not None:
        title = "Validation, on recordings that were not used for the fit:"
        blocks.append(_Block("validation", title, tuple(validation_lines(estimate))))
    if estimate.notes:
        blocks.append(_Block("notes", "Found in the data and used:", estimate.notes))
    if estimate.failures:
        blocks.append(_Block("failures", "Failed simulations:", estimate.failures))
    blocks.append(_Block("cost", "\n".join(cost_lines(estimate)), ()))
    return blocks


def _joined(blocks: Sequence[_Block], width: int | None) -> str:
    return "\n\n".join("\n".join(block.lines(width)) for block in blocks)


def _height(blocks: Sequence[_Block], width: int | None) -> int:
    return _joined(blocks, width).count("\n") + 1


def _wrapped(text: str, width: int | None, *, first: str = "", other: str | None = None) -> list[str]:
    """Return a text broken to a width, each of its lines for itself."""
    follow = first if other is None else other
    if width is None:
        return [first + part for part in text.split("\n")]
    found = []
    for part in text.split("\n"):
        found += textwrap.wrap(
            part,
            max(width, 20),
            initial_indent=first,
            subsequent_indent=follow,
            break_long_words=False,
            break_on_hyphens=False,
        )
    return found


def read_lines(estimate: Estimate) -> list[str]:
    """Return what was read of each recording, those that were read alike in one line."""
    named: dict[str, list[str]] = {}
    for read in estimate.read:
        named.setdefault(str(read["text"]), []).append(str(read["recording"]))
    return [f"read {', '.join(names)}: {text}" for text, names in named.items()]


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
    return header, rows


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


def derived_rows(estimate: Estimate) -> tuple[list[str], list[list[str]]]:
    """Return header and rows: what follows from the parameters, ± standard error, percent, unit."""
    rows = []
    for name, quantity in estimate.derived.items():
        value, error = value_texts(quantity.value, quantity.standard_error)
        relative = relative_text(quantity.standard_error, quantity.value)
        rows.append([name.replace("_", " "), value, f"± {error}", relative, quantity.unit])
    return ["derived quantity", "value", "± std. error", "", "unit"], rows


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
    """Return header and rows: output, RMSE, deviation of the treated residuals, noise of the data, unit, fit.

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
                _finite_text(rmse, ".4g"),
                _finite_text(estimate.noise.get(name, math.nan), ".3g"),
                _finite_text(estimate.sample_noise.get(name, math.nan), ".3g"),
                units.get(name, ""),
                _percent_of_fit(estimate.fit_percent.get(name)),
            ]
        )
    for column in (2, 3):
        if all(row[column] == ABSENT for row in rows):
            for row in rows:
                row[column] = ""
    return ["output", "RMSE", "residual", "noise", "", "fit"], rows


def fitted_here(validation: Validation) -> str:
    """Return what was fitted to the recordings of the validation all the same, in a sentence."""
    if not validation.chain:
        return "Nothing was fitted to these recordings."
    own = [
        f"{name} = {number_text(value, digits=4)} {validation.units.get(name, '')}".rstrip()
        for name, value in validation.chain.items()
    ]
    return f"Fitted to these recordings: {', '.join(own)}; nothing else was."


def validation_lines(estimate: Estimate) -> list[str]:
    """Return a line an output: its RMSE on the validation's recordings beside that of the fit."""
    assert estimate.validation is not None
    lines = []
    for name, rmse in estimate.validation.rmse.items():
        unit = next((c.units[name] for c in estimate.validation.comparisons if name in c.units), "")
        shown = f"{name}: RMSE {_finite_text(rmse, '.4g')} {unit}".rstrip()
        fitted = _finite_text(estimate.rmse.get(name, math.nan), ".4g")
        lines.append(f"{shown} ({fitted} where it was fitted)")
    others = estimate.validation.others
    return [*lines, fitted_here(estimate.validation), *([] if others is None else [others_text(others)])]


def others_text(others: OtherValues) -> str:
    """Say how the values that these recordings alone want agree with the estimate's."""
    return (
        f"their own parameters against the estimate's: chi-square {others.chi_square:.3g} of {others.degrees} degrees"
        f" of freedom, by chance {others.chance:.2g}"
    )


def about_line(estimate: Estimate) -> str:
    """Return what the user says of the estimate, in a line."""
    return ", ".join(f"{name} {value}" for name, value in estimate.about.items())


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
        "meaning": meaning(estimate),
        "about": estimate.about,
        "reasons": estimate.reasons,
        "places": [
            {"reason": k, "recording": p.recording, "signal": p.signal, "start": p.start, "end": p.end}
            for k, reason in enumerate(estimate.reasons)
            for p in places_of((reason,))
        ],
        "notes": estimate.notes,
        "parameters": {name: _parameter_mapping(p) for name, p in estimate.parameters.items()},
        "measurement_chain": {name: _parameter_mapping(p) for name, p in estimate.chain.items()},
        "sensors": estimate.sensors,
        "effects": estimate.effects,
        "read": estimate.read,
        "recordings": estimate.recordings,
        "derived": {
            name: {"value": q.value, "standard_error": q.standard_error, "uncertainty": q.uncertainty, "unit": q.unit}
            for name, q in estimate.derived.items()
        },
        **budget_mapping(estimate),
        "correlation": correlation,
        "information": estimate.information,
        "rivals": [_rival_mapping(rival) for rival in estimate.rivals],
        "not_visible": [_not_visible_mapping(hidden) for hidden in estimate.not_visible],
        "rmse": estimate.rmse,
        "fit_percent": estimate.fit_percent,
        "noise": estimate.noise,
        "sample_noise": estimate.sample_noise,
        "validation": None
        if estimate.validation is None
        else {
            "recordings": [c.name for c in estimate.validation.comparisons],
            "rmse": estimate.validation.rmse,
            "fit_percent": estimate.validation.fit_percent,
            "measurement_chain": estimate.validation.chain,
            "test": None
            if estimate.validation.others is None
            else {
                "chi_square": estimate.validation.others.chi_square,
                "degrees_of_freedom": estimate.validation.others.degrees,
                "p_value": estimate.validation.others.chance,
                "values": estimate.validation.others.values,
            },
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


def table(
    header: Sequence[str], rows: Iterable[Sequence[str]], *, right: Sequence[int] = (), width: int | None = None
) -> list[str]:
    """Return aligned lines; empty columns are dropped, the columns in `right` are set flush right.

    A table that is wider than `width` goes on below itself, with its first column again.
    """
    rows = [list(header), *map(list, rows)]
    used = [k for k in range(len(header)) if any(row[k] for row in rows[1:])]
    widths = {k: max(len(row[k]) for row in rows) for k in used}
    parts = [used[:1]]
    for k in used[1:]:
        if width is not None and len(parts[-1]) > 1 and sum(2 + widths[j] for j in (*parts[-1], k)) - 2 > width:
            parts.append(used[:1])
        parts[-1].append(k)
    lines: list[str] = []
    for part in parts:
        lines += [""] if lines else []
        for row in rows:
            cells = [row[k].rjust(widths[k]) if k in right else row[k].ljust(widths[k]) for k in part]
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


def _not_visible_mapping(hidden: NotVisible) -> dict[str, Any]:
    off = {name: {"relative": part, "standard_errors": bars} for name, (part, bars) in hidden.off.items()}
    return {"effect": hidden.effect, "size": hidden.size, "unit": hidden.unit, "off": off}


def _rival_mapping(rival: Rival) -> dict[str, Any]:
    return {
        "what": rival.what,
        "parameters": {
            name: {"value": p.value, "standard_error": p.standard_error, "unit": p.unit}
            for name, p in rival.parameters.items()
        },
        "differs_in": rival.differs_in,
        "standard_errors_apart": rival.apart,
        "delta_criterion": rival.behind,
        "weight": rival.weight,
        "decided_by": rival.decided_by,
    }


def _finite_text(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ABSENT


def _percent_of_fit(fit: float | None) -> str:
    """Fit in percent with the digits that differ from 100."""
    if fit is None or not math.isfinite(fit):
        return ""
    missing = 100 - fit
    if missing <= 0:
        return "100 %"
    return f"{fit:.{min(max(1 - magnitude(missing), 1), 6)}f} %"


def _count(number: int, thing: str) -> str:
    return f"{number:,} {thing}{'' if number == 1 else 's'}".replace(",", " ")
