"""What recordings may be read as in two ways, between which only a fit decides. Knows plans, no fit."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case_signals import HELD, JUMPING, LINEAR
from estimator.plans.plan import Observed, Plan
from estimator.recordings.repeated_rows import repeated_rows, written_once
from estimator.recordings.smooth_inputs import jumps

FloatArray = NDArray[np.float64]

MOVING = 0.5  # of the rows in which an input changes: it does not go from level to level


@dataclass(frozen=True)
class Interpretation:
    """A plan in one of two ways to read its recordings.

    Attributes
    ----------
    effect : str
        What is read in one of them; "": there is one way.
    way : str
        How, in words.
    told : str
        What was read of these recordings, where this way explains them better.
    remedy : str
        What would decide.
    """

    plan: Plan
    effect: str = ""
    way: str = ""
    told: str = ""
    remedy: str = ""


def interpretations(plan: Plan) -> tuple[Interpretation, ...]:
    """Return the ways to read the recordings of a plan, two at most, the usual one first."""
    return _between_rows(plan) or _repeated(plan) or (Interpretation(plan),)


def inputs_between(plan: Plan) -> tuple[str, ...]:
    """Return the inputs that move from row to row, where the case does not say how; of a motor what is measured.

    A motor's command is held.
    """
    open_ones = [n for n in plan.observed[0].inputs if n not in (*plan.case.linear, *plan.case.held)]
    if plan.binding.is_motor:
        observed = [o for o in plan.observed if o.is_measured]
        return tuple(n for n in open_ones if any(_goes_on(o.inputs[n]) for o in observed))
    return tuple(n for n in open_ones if any(_moves(o.inputs[n]) for o in plan.observed))


def _goes_on(v: FloatArray) -> bool:
    """Whether an input, (n,), moves smoothly, but for a few jumps."""
    return bool(np.any((np.diff(v) != 0) & ~jumps(v)[1:]))


def _moves(u: FloatArray) -> bool:
    """Whether an input, (n,), changes in most rows."""
    return bool(np.mean(np.diff(u) != 0) > MOVING)


def _between_rows(plan: Plan) -> tuple[Interpretation, ...]:
    """Return inputs held from row to row, and on lines."""
    moving = inputs_between(plan)
    if not moving:
        return ()
    is_motor, case = plan.binding.is_motor, plan.case
    jumping = tuple(n for n in moving if is_motor and any(jumps(o.inputs[n]).any() for o in plan.observed))
    case = dataclasses.replace(case, linear=(*case.linear, *moving), jumping=(*case.jumping, *jumping))
    observed = [
        dataclasses.replace(o, jumps={**o.jumps, **{n: jumps(o.inputs[n]) for n in jumping}}) for o in plan.observed
    ]
    on_lines = dataclasses.replace(plan, case=case, observed=tuple(observed))
    column = next((read.column for o in plan.observed for read in o.read if read.signal == moving[0]), "…")
    remedy = (
        f'say which it is in a case file, under [inputs]: {moving[0]} = {{ column = "{column}", between = "{HELD}" }}'
        f' or "{JUMPING if jumping else LINEAR}"'
    )
    names = ", ".join(moving)
    return tuple(
        Interpretation(
            p, "inputs between the rows", f"{names} {way} from row to row",
            f"between the rows: {names} {way}, which explains the recording better", remedy,
        )
        for p, way in ((plan, "held"), (on_lines, "on a line between its jumps" if jumping else "on a line"))
    )  # fmt: skip


def _repeated(plan: Plan) -> tuple[Interpretation, ...]:
    """Return rows that show the row before once more at their time, and rows that were written twice."""
    found = [repeated_rows(o.inputs, o.outputs) for o in plan.observed]
    if not any(map(len, found)) or not plan.description.capabilities.get(
        "canHandleVariableCommunicationStepSize", True
    ):
        return ()
    stale, once = [], []
    for o, rows in zip(plan.observed, found, strict=True):
        missing = {name: y.copy() for name, y in o.outputs.items()} if len(rows) else o.outputs
        for y in missing.values() if len(rows) else ():
            y[rows] = np.nan
        stale.append(dataclasses.replace(o, outputs=missing))
        taken = written_once(o.recording.time, rows) if len(rows) else o.taken
        once.append(dataclasses.replace(stale[-1], taken=taken))
    remedy = "record again with a logger that writes each row once"
    seen = f"{_where(plan.observed, found)} the row before once more, and are left out; by the fit,"
    return (
        Interpretation(
            dataclasses.replace(plan, observed=tuple(stale)), "repeated rows", "repeated rows at their time",
            f"{seen} the clock is right", remedy,
        ),
        Interpretation(
            dataclasses.replace(plan, observed=tuple(once)), "repeated rows", "rows written twice",
            f"{seen} they were written twice, and what follows was measured as many rows earlier than the clock says",
            remedy,
        ),
    )  # fmt: skip


def _where(observed: tuple[Observed, ...], found: list[np.ndarray]) -> str:
    """Say how many rows of which recordings."""
    many = [f"{len(rows)} of {o.recording.title}" for o, rows in zip(observed, found, strict=True) if len(rows)]
    return f"rows ({', '.join(many)}) show"
