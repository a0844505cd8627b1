"""Which kind of an FMU that offers both is simulated, where nobody chose: found by stepping both. Knows no case.

A co-simulation FMU brings its own solver, which may be coarse, or ignore the communication step; the equations of its
model exchange are integrated here to a tolerance. Where the two lie apart at the recording's step, the latter is used.
"""

from __future__ import annotations

import contextlib
import time
from typing import Any

from estimator.errors import FmuError
from estimator.fmus.fmu import FmuDescription, with_kind
from estimator.fmus.probe import LARGE_DISTANCE, driven
from estimator.fmus.probe_stages import Stages, Stopped
from estimator.fmus.run_folder import RunFolder

STEPS = 50  # that are compared
SHARE = 0.7  # of the inputs that the probe takes
LIMIT = 30.0  # s, for each kind: long, so that a busy machine chooses as an idle one does


def better_kind(description: FmuDescription, step: float) -> tuple[FmuDescription, str]:
    """Return the description with the kind to use, and a sentence where that is not what it says now.

    Parameters
    ----------
    step : s, communication step
    """
    if description.is_bundled or len(description.kinds) < 2 or description.kind != "co-simulation":
        return description, ""
    equations = with_kind(description, "model-exchange")
    samples = [_samples(d, step) for d in (description, equations)]
    apart = _apart(*samples)
    if apart <= LARGE_DISTANCE:
        return description, ""
    with contextlib.suppress(FmuError):
        return driven(equations), (
            f"{description.path.name} is simulated for model exchange: at a step of {step:g} s its co-simulation lies"
            f" {100 * apart:.2g} % of the outputs' range from its own equations; choose it with --kind co-simulation"
        )
    return description, ""


def _samples(description: FmuDescription, step: float) -> list[list[float]]:
    """Return what is read step by step from the start values; nothing where it does not run."""
    try:
        with RunFolder() as folder, Stages(description, folder, until=time.monotonic() + LIMIT) as owner:
            owner.order |= {"h": step, "horizon": STEPS * step, "patience": LIMIT}
            owner.order["inputs"] = [SHARE * u for u in owner.order["inputs"]]  # off any balance at the start
            found: dict[str, Any] = owner.stage("samples", limit=LIMIT)
    except (Stopped, OSError):
        return []
    return list(found.get("rows", []))


def _apart(rows: list[list[float]], others: list[list[float]]) -> float:
    """Return the largest distance, of the range that an output goes through in the other rows; 0 without rows."""
    worst = 0.0
    for column, other in zip(zip(*rows, strict=True), zip(*others, strict=True), strict=False):  # by outputs
        span = max(other) - min(other)
        if span > 0:
            worst = max(worst, max(abs(x - y) for x, y in zip(column, other, strict=False)) / span)
    return worst
