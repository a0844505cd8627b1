"""An estimate as one JSON object, for a program. Knows only the result; computes nothing new."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from estimator.results.budget_table import budget_mapping
from estimator.results.reason import places_of
from estimator.results.report_sentences import meaning
from estimator.results.result import Estimate, NotVisible, ParameterEstimate, Rival


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
    said = {"effect": hidden.effect, "size": hidden.size, "unit": hidden.unit, "whatever_size": hidden.whatever_size}
    return {**said, "off": off}


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
