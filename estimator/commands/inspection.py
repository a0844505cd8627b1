"""What an FMU is, what can be estimated in it, and what would go wrong, as text and JSON. Executes nothing itself."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from estimator.cases.roles import guess_roles
from estimator.errors import FmuError
from estimator.fmus.fmu import FmuDescription, check_usable
from estimator.fmus.probe import LARGE_CHANGE, Probe, disagreement
from estimator.fmus.variable import Variable
from estimator.results.numbers import number_text
from estimator.results.result_json import json_ready
from estimator.results.text_table import TextTable

SHOWN = 5  # names, or findings, in one list


def estimable(description: FmuDescription) -> tuple[Variable, ...]:
    """Return the variables that an estimation could change: real parameters, fixed or tunable."""
    return tuple(v for v in description.of_causality("parameter") if v.is_real)


def obstacles(description: FmuDescription, probe: Probe | None = None) -> list[str]:
    """Return what keeps this FMU from being used here, one sentence each; empty when nothing does.

    Parameters
    ----------
    probe : of the kind that is used, if it was probed
    """
    found = []
    try:
        check_usable(description)
    except FmuError as error:
        found.append(str(error))
    if probe is not None and not probe.runs and probe.problem not in found:
        found.append(probe.problem)
    if description.capabilities.get("needsExecutionTool") and not (probe is not None and probe.runs):
        found.append(f"it needs its tool, {description.generation_tool}, to be installed and running")
    if not estimable(description):
        found.append("it has no real parameter, so nothing can be estimated")
    if not comparable(description):
        found.append("it has no real output and no other variable to compare a recording with")
    return found


def comparable(description: FmuDescription) -> tuple[Variable, ...]:
    """Return the real variables that a recording may be compared with: outputs, or where there are none all others."""
    outputs = tuple(v for v in description.of_causality("output") if v.is_real)
    return outputs or tuple(v for v in description.of_causality("local") if v.is_real)


def remarks(description: FmuDescription, probe: Probe | None = None) -> list[str]:
    """Return what is unusual about an FMU and keeps it from nothing."""
    found = []
    if not description.of_causality("input"):
        found.append("it has no inputs: a recording shows how it moves by itself, from where it begins")
    if not any(v.is_real for v in description.of_causality("output")) and comparable(description):
        names = ", ".join(v.name for v in comparable(description)[:SHOWN])
        more = len(comparable(description)) - SHOWN
        found.append(
            f"it has no real outputs; name under [outputs] which of its local variables a column shows: {names}"
            + (f" and {more} more" if more > 0 else "")
        )
    if description.capabilities.get("needsExecutionTool") and probe is not None and probe.runs:
        found.append(f"it says that it needs its tool, {description.generation_tool}; here it runs without")
    return found


def choice_of_kind(description: FmuDescription) -> str:
    """Return which kind is used and why, where the FMU offers both; else nothing."""
    if len(description.kinds) < 2:
        return ""
    other = next(kind for kind in description.kinds if kind != description.kind)
    why = {
        "co-simulation": "the FMU then brings its own solver",
        "model-exchange": "as it was chosen; a solver of this program's then integrates the FMU's equations",
    }[description.kind]
    return f"it is used for {description.kind}: {why}; choose {other} with --kind, or with kind under [fmu]"


def grouped(sentences: Sequence[str]) -> list[str]:
    """Return sentences of a validator, those that differ in places or names only as one: the first, and how many."""
    groups: dict[str, list[str]] = {}
    for sentence in sentences:
        groups.setdefault(re.sub(r"\(line [^)]*\)|\"[^\"]*\"|'[^']*'", "", sentence), []).append(sentence)
    lines = [f"{g[0]}{f' (and {len(g) - 1} more such)' if len(g) > 1 else ''}" for g in groups.values()]
    return [*lines[:SHOWN], *([f"and {len(lines) - SHOWN} findings of other kinds"] if len(lines) > SHOWN else [])]


def inspection_text(description: FmuDescription, probes: Mapping[str, Probe] | None = None) -> str:
    """Return the description, and what the probe of each kind found, as lines for a person."""
    facts = [
        ["file", str(description.path)],
        ["model", _with(description.model_name, description.description)],
        ["FMI", f"{description.fmi_version}, {' and '.join(description.kinds) or 'of no kind'}"],
        ["platforms", ", ".join(description.platforms) or "none"],
        ["made by", description.generation_tool],
        ["GUID", description.guid],
    ]
    experiment = {name.replace("_", " "): value for name, value in description.default_experiment.items() if value}
    if experiment:
        shown = (f"{name} {value:g}{'' if name == 'tolerance' else ' s'}" for name, value in experiment.items())
        facts.append(["experiment", ", ".join(shown)])
    able = [name for name, yes in description.capabilities.items() if yes]
    facts.append(["capabilities", ", ".join(able) or "none stated"])
    width = max(len(name) for name, _ in facts)
    lines = [f"{name.ljust(width)}  {value}" for name, value in facts]
    for title, variables in (
        ("Parameters that can be estimated", estimable(description)),
        ("Inputs", description.of_causality("input")),
        ("Outputs", description.of_causality("output")),
    ):
        lines += ["", f"{title}:", *(f"  {line}" for line in _variables(variables))]
    roles = guess_roles(description)
    if roles:
        lines += [
            "",
            "What looks like a motor's:",
            *(f"  {r.ljust(4)}  {', '.join(names)}" for r, names in roles.items()),
        ]
    if choice := choice_of_kind(description):
        lines += ["", f"It offers both kinds; {choice}."]
    for kind, probe in (probes or {}).items():
        title = f"What the probe found, for {kind}:" if len(description.kinds) > 1 else "What the probe found:"
        lines += ["", title, *_items(probe_sentences(probe))]
    if apart := disagreement(probes or {}):
        lines += ["", f"{apart[0].upper()}{apart[1:]}."]
    used = (probes or {}).get(description.kind)
    problems = obstacles(description, used)
    lines += ["", "What would go wrong:", *_items(problems)] if problems else ["", "Nothing keeps it from use here."]
    if noted := remarks(description, used):
        lines += ["", "Worth knowing:", *_items(noted)]
    if description.warnings:
        lines += ["", "What the validation found:", *_items(grouped(description.warnings))]
    return "\n".join(lines) + "\n"


def probe_sentences(probe: Probe) -> list[str]:
    """Return what a probe found, for people."""
    if not probe.runs:
        return [probe.problem]
    lines = []
    if probe.seconds is not None and probe.step is not None:
        span = probe.steps * probe.step
        lines.append(f"it loads and runs: {span:.4g} s in {probe.steps} steps took {1e3 * probe.seconds:.3g} ms")
    kept = {
        "repeats itself": probe.repeats,
        "honours reset": probe.reset,
        "keeps two instances apart": probe.apart,
        "honours the step": probe.honours_step,
    }
    moved = any(s is None or s > 0 for s in probe.span)
    good = [what for what, yes in kept.items() if yes and (moved or what == "repeats itself")]
    if good:
        lines.append(f"it {', '.join(good)}")
    taken = [name for name, answer in probe.parameters.items() if answer == "taken"]
    if taken:
        lines.append(f"it takes {', '.join(taken)}")
    if probe.step_change is not None and probe.step_change <= LARGE_CHANGE:  # a larger one is among the findings
        lines.append(f"a ten times finer step changes its outputs by {100 * probe.step_change:.2g} % of their range")
    return [*lines, *probe.findings]


def inspection_mapping(description: FmuDescription, probes: Mapping[str, Probe] | None = None) -> dict[str, Any]:
    """Return the description for JSON: plain dictionaries, lists, strings and finite numbers.

    "probe" is that of the kind that is used, "probes" holds each kind's.
    """
    found = {kind: dataclasses.asdict(probe) for kind, probe in (probes or {}).items()}
    mapping = {
        "name": description.name,
        "path": description.path,
        "model_name": description.model_name,
        "description": description.description,
        "fmi_version": description.fmi_version,
        "kinds": description.kinds,
        "platforms": description.platforms,
        "generation_tool": description.generation_tool,
        "guid": description.guid,
        "parameters": [_variable_mapping(v) for v in estimable(description)],
        "inputs": [_variable_mapping(v) for v in description.of_causality("input")],
        "outputs": [_variable_mapping(v) for v in description.of_causality("output")],
        "capabilities": description.capabilities,
        "default_experiment": description.default_experiment,
        "problems": obstacles(description, (probes or {}).get(description.kind)),
        "remarks": remarks(description, (probes or {}).get(description.kind)),
        "disagreement": disagreement(probes or {}),
        "warnings": description.warnings,
        "kind": description.kind,
        "roles": guess_roles(description),
        "kind_reason": choice_of_kind(description),
        "probe": found.get(description.kind),
        "probes": found,
    }
    plain: dict[str, Any] = json_ready(mapping)
    return plain


def _variable_mapping(variable: Variable) -> dict[str, Any]:
    return {
        "name": variable.name,
        "unit": variable.unit,
        "start": variable.start,
        "min": variable.minimum,
        "max": variable.maximum,
        "nominal": variable.nominal,
        "type": variable.type,
        "variability": variable.variability,
        "description": variable.description,
    }


def _variables(variables: Iterable[Variable]) -> list[str]:
    rows = [
        [v.name, v.unit, _number(v.start), _number(v.minimum), _number(v.maximum), v.description] for v in variables
    ]
    found = TextTable(["name", "unit", "start", "min", "max", "description"], rows, (2, 3, 4))
    return found.lines() if rows else ["none"]


def _number(value: float | str | None) -> str:
    return "" if value is None else value if isinstance(value, str) else number_text(value)


def _with(text: str, more: str) -> str:
    return f"{text}: {more}" if more else text


def _items(sentences: Iterable[str]) -> list[str]:
    return [f"  - {sentence}" for sentence in sentences]
