"""Uncertainty budget: systematic errors that no recording shows, propagated through a fit to each parameter.

If the bench has an effect that changes what the sensors show by c, whitened W c, the estimate is off by

    d = (J'J)^-1 J' W c

on the parameters' scales (GUM 5.1.3, with the fit for the function f). c is simulated at the fit, through its FMU, for
one standard uncertainty either way. What J does not explain of W c is visible in the recordings: several levels, for
example, show a brush drop. The source's coefficient b, in standard uncertainties, is then estimated from A, the rest of
W c, with its standard uncertainty as prior: its variance is (1 + A'A)^-1. The share of the source is d sqrt(variance +
b^2), never more than d, because the estimate does not contain b.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.cases.tolerance import CLOCK, Tolerance
from estimator.conventions import TOLD_POWER
from estimator.errors import CaseError, suggestion
from estimator.fitting.fit import Fit, new_fit
from estimator.fitting.gauss_newton import solved
from estimator.fitting.information import information_parts
from estimator.fitting.simulator import Simulator
from estimator.fmus.workers import Workers
from estimator.motor.winding import COPPER, REFERENCE, relative_resistance
from estimator.noise.clock import over_steps
from estimator.noise.noise_model import NoiseModel
from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]

UNITS = {"voltage": "V", "current": "A", "speed": "rad/s"}


@dataclass(frozen=True)
class Budget:
    """The share of each source in the uncertainty of each parameter.

    Attributes
    ----------
    tolerances : the sources, s of them
    names : (p,) names
    shifts : (p, s) array
        On the names' scales, for one standard uncertainty, reduced by what the recordings show of it.
    left : (s,) array
        Part of each standard uncertainty that remains, 0 to 1.
    failed : sources whose effect the FMU could not simulate
    """

    tolerances: tuple[Tolerance, ...]
    names: tuple[str, ...]
    shifts: FloatArray
    left: FloatArray
    failed: tuple[str, ...] = ()

    def of(self, gradient: FloatArray) -> dict[str, float]:
        """Return source → change of a quantity with this (p,) gradient by the names' scaled values."""
        return {t.source: float(d) for t, d in zip(self.tolerances, gradient @ self.shifts, strict=True)}


def applicable(plan: Plan) -> tuple[Tolerance, ...]:
    """Return the tolerances of a plan's case, without those of the default set that do not apply to it.

    Raises
    ------
    CaseError
        A tolerance was given that does not apply to the case.
    """
    found = []
    for tolerance in plan.case.tolerance:
        lack = _lack(tolerance, plan)
        if lack and not tolerance.offered:
            raise CaseError(f"the tolerance {tolerance.source!r} {lack}; leave it out")
        found += [] if lack else [tolerance]
    return tuple(found)


def budget(fit: Fit, tolerances: Sequence[Tolerance], names: Sequence[str]) -> Budget:
    """Return the budget of a fit for some of its names; a name that it does not free does not move."""
    if not tolerances:
        return Budget((), tuple(names), np.zeros((len(names), 0)), np.zeros(0))
    columns = np.stack([_column(fit, t) for t in tolerances], axis=2)
    simulated = np.asarray(np.isfinite(columns).all(axis=(0, 1)))
    failed = tuple(t.source for t, good in zip(tolerances, simulated, strict=True) if not good)
    tolerances = [t for t, good in zip(tolerances, simulated, strict=True) if good]
    columns = columns[:, :, simulated]
    if not tolerances:
        return Budget((), tuple(names), np.zeros((len(names), 0)), np.zeros(0), failed)
    whitened = fit.whitener(columns)[0].reshape(fit.z.size, -1)
    inside = np.flatnonzero(fit.at_bound == 0)
    jacobian = fit.jacobian[:, inside]
    moved = np.zeros((len(fit.names), len(tolerances)))
    triangle = np.asarray(np.linalg.qr(jacobian, mode="r"))
    moved[inside] = information_parts(triangle)[0] @ (jacobian.T @ whitened)
    test = fit.test()
    across = test.known.rest(whitened)
    across[:, np.sum(across**2, axis=0) <= TOLD_POWER * np.sum(whitened**2, axis=0)] = 0.0
    variance = np.linalg.inv(np.eye(len(tolerances)) + across.T @ across)
    size = variance @ (across.T @ test.left)
    left = np.minimum(np.sqrt(np.diag(variance) + size**2), 1.0)
    place = {name: k for k, name in enumerate(fit.names)}
    shifts = np.array([moved[place[n]] if n in place else np.zeros(len(tolerances)) for n in names])
    return Budget(tuple(tolerances), tuple(names), shifts.reshape(len(names), -1) * left, left, failed)


def fit_at(plan: Plan, crew: Workers, values: FloatArray, *, sigma: Mapping[str, float]) -> Fit:
    """Return a fit at given values, (p,), with white noise: for methods that find no effects.

    Parameters
    ----------
    sigma : output → float
        Deviations that weigh the outputs.
    """
    simulator = Simulator(plan, (), crew, sigma)
    noise = NoiseModel.plain(np.array([sigma[y] for y in plan.outputs]), [-1] * len(plan.outputs))
    return solved(new_fit(simulator, values, plan.names, noise), iterations=0)


def _lack(tolerance: Tolerance, plan: Plan) -> str:
    """Say what a case lacks for a tolerance; "" if nothing."""
    source, inputs = tolerance.source, tuple(plan.observed[0].inputs)
    if tolerance.signal:
        known = (*plan.outputs, *inputs)
        said = "" if tolerance.signal in known else suggestion(tolerance.signal, known)
        return f"is of no output or input of this case{said}" if tolerance.signal not in known else ""
    circuit = _one(plan, inputs, "voltage") and _one(plan, plan.outputs, "current")
    resistance = _resistances(plan) or "R" in plan.fixed
    if source == "temperature" and not resistance:
        return "needs a winding's resistance R among the parameters"
    if source == "supply resistance" and not (resistance or circuit):
        return "needs a resistance R among the parameters, or a voltage input and a current output"
    if source == "brush drop" and not circuit:
        return "needs one voltage input and one current output"
    if source == "dry friction" and not (_load(plan) and _one(plan, plan.outputs, "speed")):
        return "needs the FMU's input of a load torque, and one speed output"
    if source == "dry friction" and not tolerance.unit and "B" not in {*plan.names, *plan.fixed}:
        return "is a share of the viscous friction, and the case has no B; give it in N.m"
    return ""


def _column(fit: Fit, tolerance: Tolerance) -> FloatArray:
    """Return the change of the sensors' signals, (rows, q), by one standard uncertainty."""
    s, u, source = fit.simulator, tolerance.standard_uncertainty, tolerance.source
    plan = s.plan
    if tolerance.signal in s.outputs:
        column = np.zeros_like(fit.shown)
        j = s.outputs.index(tolerance.signal)
        column[:, j] = u * fit.shown[:, j]
        return column
    if source == CLOCK:
        return _by_clock(fit, u)
    if tolerance.signal:  # shown too large, as an output: what drives the model is less
        return _driven(fit, tolerance.signal, -u * s.inputs(tolerance.signal))
    if source == "temperature" or (source == "supply resistance" and (_resistances(plan) or "R" in plan.fixed)):

        def more(resistance: float, recording: int | None) -> float:
            if source != "temperature":
                return u
            known = plan.temperatures[recording or 0] if plan.temperatures else None
            return u * resistance * COPPER / relative_resistance(REFERENCE if known is None else known)

        return _more_resistance(fit, more)
    inputs = tuple(plan.observed[0].inputs)
    if source == "dry friction":
        w = fit.shown[:, s.outputs.index(_one(plan, plan.outputs, "speed"))]
        known = {**plan.fixed, **dict(zip(s.names, fit.values.tolist(), strict=True))}
        torque = u if tolerance.unit else u * known["B"] * float(np.max(np.abs(w)))
        return _driven(fit, _load(plan), torque * np.sign(over_steps(w, s.clocks)))
    i = fit.shown[:, s.outputs.index(_one(plan, plan.outputs, "current"))]
    drop = over_steps(i, s.clocks)
    return _driven(fit, _one(plan, inputs, "voltage"), -u * (drop if source == "supply resistance" else np.sign(drop)))


def _driven(fit: Fit, name: str, more: FloatArray) -> FloatArray:
    """Return the change of the sensors' signals by an input changed by (rows,): a central difference."""
    s = fit.simulator

    def plan(sign: int) -> Plan:
        observed = []
        for o, clock in zip(s.plan.observed, s.clocks, strict=True):
            variable = s.plan.binding.signal(name)
            usual = float(variable.start or 0.0) if isinstance(variable.start, int | float) else 0.0
            was = o.inputs.get(name, np.full(len(o.recording.time), usual))
            observed.append(dataclasses.replace(o, inputs={**o.inputs, name: was + sign * more[clock.rows]}))
        return dataclasses.replace(s.plan, observed=tuple(observed))

    ahead, behind = (
        Simulator(plan(sign), s.nuisances, s.crew, s.sigma).shown(fit.values[None, :])[0] for sign in (1, -1)
    )
    return np.asarray((ahead - behind) / 2)


def _by_clock(fit: Fit, more: float) -> FloatArray:
    """Return the change of the sensors' signals, (rows, q), by a clock that shows intervals too long by a share."""
    s = fit.simulator

    def slower(share: float) -> Simulator:
        case, observed = s.plan.case, []
        for o in s.plan.observed:
            own, taken = o.recording, o.taken
            recording = dataclasses.replace(own, time=own.time * share, step=own.step * share)
            taken = None if taken is None else taken * share
            observed.append(dataclasses.replace(o, recording=recording, taken=taken))
        case = case if case.step is None else dataclasses.replace(case, step=case.step * share)
        plan = dataclasses.replace(s.plan, case=case, observed=tuple(observed))
        return Simulator(plan, s.nuisances, s.crew, s.sigma)

    shorter, longer = (slower(1 + sign * more).shown(fit.values[None, :])[0] for sign in (-1, 1))
    return np.asarray((shorter - longer) / 2)


def _more_resistance(fit: Fit, more: Callable[[float, int | None], float]) -> FloatArray:
    """Return the change of the sensors' signals if each resistance R grows by `more` of it and its recording."""
    s = fit.simulator
    shown = []
    for sign in (1, -1):
        values, fixed = fit.values.copy(), dict(s.plan.fixed)
        for k in _resistances(s.plan):
            values[k] += sign * more(float(values[k]), s.plan.parameters[k].recording)
        simulator = s
        if not _resistances(s.plan):
            fixed["R"] += sign * more(fixed["R"], None)
            simulator = Simulator(dataclasses.replace(s.plan, fixed=fixed), s.nuisances, s.crew, s.sigma)
        shown.append(simulator.shown(values[None, :])[0])
    return np.asarray((shown[0] - shown[1]) / 2)


def _one(plan: Plan, names: Sequence[str], quantity: str) -> str:
    """Return the one signal of a quantity; "" where there is none, or more than one."""
    found = [n for n in names if plan.unit(n) == UNITS[quantity]]
    return found[0] if len(found) == 1 else ""


def _load(plan: Plan) -> str:
    """Return the FMU's one input that is a torque; ""."""
    found = [name for name, v in plan.binding.inputs.items() if v.unit == "N.m"]
    return found[0] if len(found) == 1 else ""


def _resistances(plan: Plan) -> list[int]:
    """Return which parameters are the winding's resistance, one of each recording or one of all."""
    return [k for k, p in enumerate(plan.parameters) if (p.quantity or p.name) == "R"]
