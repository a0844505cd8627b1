"""The cube that a search looks through, and how its points become candidates. Knows the steady-state relations.

Five unknowns become three: the paper draws K, L, J and computes R and B; the default draws R, L, J, the better
conditioned half of the same relations. Where the relations do not hold, all free parameters are searched.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.motor.names import MOTOR
from estimator.motor.steady_state import SteadyState, last_samples
from estimator.plans.parameters import Box
from estimator.plans.plan import Plan
from estimator.recordings.samples import mean_of_known
from estimator.recordings.settling import Settling, find_settling

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Steady:
    """The steady state of a single step, and whether it can be trusted."""

    settling: Settling
    state: SteadyState


@dataclass(frozen=True)
class Space:
    """The cube that is searched, and how its points become candidates.

    Attributes
    ----------
    box : Box
        Of the searched parameters.
    index : their positions among the free parameters
    complete : fills (n, p) candidates, of which only `index` is set, in place
    redraw : as CuckooSearch takes it
    """

    box: Box
    index: tuple[int, ...]
    dimension: int
    complete: Callable[[FloatArray], None] | None = None
    redraw: Callable[[FloatArray, np.random.Generator], FloatArray] | None = None

    @classmethod
    def full(cls, box: Box) -> Space:
        """Return the space of all free parameters."""
        return cls(box, tuple(range(box.dimension)), box.dimension)

    def values(self, cube: FloatArray) -> FloatArray:
        """Return (n, p) candidates of (n, d) points of the cube."""
        candidates = np.empty((len(cube), self.dimension))
        candidates[:, list(self.index)] = self.box.from_cube(cube)
        if self.complete is not None:
            self.complete(candidates)
        return candidates

    def cube(self, candidate: FloatArray) -> FloatArray:
        """Return the point of the cube, (d,), that is nearest to a candidate."""
        return self.box.to_cube(candidate[list(self.index)])


def paper_space(plan: Plan, box: Box) -> Space:
    """Return the paper's space: K, L, J drawn, R and B from the relations, K drawn again when they leave their bounds.

    The relations are monotonic in K, so the allowed K are an interval, and drawing again until R and B fit is a draw
    from it.
    """
    names = plan.names
    if not {"R", "K", "B"} <= set(names):
        raise InputError("method 'paper' needs R, K and B free; fix only L or J, or use another method")
    observed = plan.observed[0]
    if not {"i", "w"} <= set(observed.outputs) or "v" not in observed.inputs:
        raise InputError("method 'paper' needs voltage, current and speed; use method 'cuckoo'")
    if len(plan.observed) > 1:
        raise InputError("method 'paper' takes one recording; use method 'cuckoo' for several")
    state = last_samples(observed.inputs["v"], observed.outputs["i"], observed.outputs["w"])
    if missing := [title for title, mean in (("current", state.i), ("speed", state.w)) if np.isnan(mean)]:
        raise InputError(f"method 'paper' needs the {missing[0]} of the last samples; use method 'cuckoo'")
    bounds = {p.name: (p.lower, p.upper) for p in plan.parameters}
    feasible = state.feasible_constant(R=bounds["R"], K=bounds["K"], B=bounds["B"]) if state.is_usable else None
    if feasible is None:
        raise InputError(
            f"no K within its bounds {bounds['K'][0]:g} to {bounds['K'][1]:g} gives R and B within theirs by the"
            f" steady-state relations (v = {state.v:.4g} V, i = {state.i:.4g} A, w = {state.w:.4g} rad/s at the"
            " end); widen the bounds with --bounds, or use method 'cuckoo'"
        )
    drawn = ["K", *(n for n in names if n not in ("R", "K", "B"))]
    index = tuple(names.index(n) for n in drawn)
    inner = Box(box.lower[list(index)], box.upper[list(index)], box.log[list(index)])
    R, K, B = (names.index(n) for n in ("R", "K", "B"))
    low, high = (inner.to_cube(np.array([k, *inner.lower[1:]]))[0] for k in feasible)

    def complete(candidates: FloatArray) -> None:
        candidates[:, R] = np.clip(state.resistance(candidates[:, K]), *bounds["R"])
        candidates[:, B] = np.clip(state.friction(candidates[:, K]), *bounds["B"])

    def redraw(eggs: FloatArray, rng: np.random.Generator) -> FloatArray:
        outside = (eggs[:, 0] < low) | (eggs[:, 0] > high)
        eggs[outside, 0] = rng.uniform(low, high, int(outside.sum()))
        return eggs

    return Space(inner, index, len(names), complete, redraw)


def reduced_space(plan: Plan, box: Box, steady: Steady | None) -> Space | None:
    """Return the default's reduced space: R, L, J searched, K and B from the relations; None where they do not hold."""
    names = plan.names
    if steady is None or not steady.settling.settled or set(MOTOR) != set(names):
        return None  # another free parameter, such as Coulomb friction, has its part in the settled state
    state = steady.state
    if not state.is_usable:
        return None
    bounds = {p.name: (p.lower, p.upper) for p in plan.parameters}
    feasible = state.feasible_constant(R=bounds["R"], K=bounds["K"], B=bounds["B"])
    if feasible is None:
        return None
    allowed_R = sorted(float(state.resistance(np.asarray(k))) for k in feasible)
    low, high = max(bounds["R"][0], allowed_R[0]), min(bounds["R"][1], allowed_R[1])
    if not 0 < low < high:
        return None
    index = tuple(names.index(n) for n in ("R", "L", "J"))
    lower, upper = box.lower[list(index)].copy(), box.upper[list(index)].copy()
    lower[0], upper[0] = low, high
    inner = Box(lower, upper, box.log[list(index)])
    R, K, B = (names.index(n) for n in ("R", "K", "B"))

    def complete(candidates: FloatArray) -> None:
        candidates[:, K] = np.clip(state.constant(candidates[:, R]), *bounds["K"])
        candidates[:, B] = np.clip(state.friction(candidates[:, K]), *bounds["B"])

    return Space(inner, index, len(names), complete)


def steady_state(plan: Plan) -> Steady | None:
    """Return the steady state of a plan's only recording, if that is a motor's single step."""
    if len(plan.observed) != 1 or not {"i", "w"} <= set(plan.outputs):
        return None
    observed = plan.observed[0]
    if observed.excitation.kind != "step" or "v" not in observed.inputs:
        return None
    if any(np.any(u != 0) for name, u in observed.inputs.items() if name != "v"):
        return None  # a load torque: the relations do not hold
    settling_ones = {name: y for name, y in observed.outputs.items() if name != "angle"}
    settling = find_settling(observed.excitation, settling_ones, interval=observed.recording.step)
    part = slice(settling.start, None)
    means = (observed.inputs["v"][part], observed.outputs["i"][part], observed.outputs["w"][part])
    return Steady(settling, SteadyState(*map(mean_of_known, means)))
