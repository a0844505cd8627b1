"""How the recordings of a result were read, and how implausible data lower its verdict. Simulates nothing."""

from __future__ import annotations

import dataclasses
from typing import Any

from estimator.judging.outcome import measured
from estimator.judging.refusal import implausible_reason
from estimator.plans.plan import Observed, Plan
from estimator.recordings.understood import not_used
from estimator.results.result import Estimate

# Implausible data, and effects that explain them: no reason for doubt if one of these is estimated.
EXPLAINS = {"coasts": {"coasting", "one-way current"}, "dead band": {"dry friction", "dead band"}}


def with_what_was_read(found: Estimate, plan: Plan) -> Estimate:
    """Return an estimate with what was read; implausible data make it doubtful, or show why it is refused."""
    open_ones = [
        (o, f) for o in plan.observed for f in o.findings if not EXPLAINS.get(f.kind, set()) & {*found.effects}
    ]
    doubts = [implausible_reason(o, f) for o, f in open_ones if not f.is_harmless and f.sentence not in found.reasons]
    told = [f.sentence for _, f in open_ones if f.is_harmless]
    found = dataclasses.replace(found, read=what_was_read(plan), notes=(*told, *found.notes))
    if found.verdict == "refused":
        moved = any(o.excitation.kind != "none" for o in plan.observed)
        return found if found.comparisons or not moved else dataclasses.replace(found, comparisons=measured(plan))
    if not doubts:
        return found
    why = doubts[0]  # a unit that is not what it seems makes all of them wrong
    parameters = {
        name: dataclasses.replace(p, status="doubtful", reason=why) if p.status == "ok" else p
        for name, p in found.parameters.items()
    }
    return dataclasses.replace(found, verdict="doubtful", parameters=parameters, reasons=(*doubts, *found.reasons))


def what_was_read(plan: Plan) -> tuple[dict[str, Any], ...]:
    """Return what was read, one mapping a recording, as `Estimate.read` holds it."""
    return tuple(
        {
            "recording": o.recording.name,
            "signals": {u.signal: {k: v for k, v in u.mapping().items() if k != "signal"} for u in o.read},
            "text": " · ".join([*(u.text() for u in o.read), *_not_used(o)]),
            "implausible": [finding.sentence for finding in o.findings],
        }
        for o in plan.observed
    )


def _not_used(o: Observed) -> list[str]:
    """Say which columns are not used where a motor's current or motion is missing: it may be one of them."""
    signals, recording = {u.signal for u in o.read}, o.recording
    if "v" not in signals or ("i" in signals and signals & {"w", "angle"}):
        return []
    read = {u.column for u in o.read}
    rest = not_used(recording, [c for c, header in recording.headers.items() if header in read or c in recording.made])
    return [f"not used: {', '.join(rest)}"] if rest else []
