"""From a plan, an optimum and a judgement to the parts of an Estimate. Knows no search and simulates nothing."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.cases.case_signals import run_value
from estimator.conventions import NOTHING_TOLD
from estimator.explaining.explained import Explained
from estimator.fitting.information import scaled_svd
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.projection import triangle
from estimator.judging.verdict import Judgement
from estimator.plans.parameters import Parameter
from estimator.plans.plan import ChainSpec, Plan
from estimator.results.result import Comparison, ParameterEstimate, Setting
from estimator.stepping import layout

FloatArray = NDArray[np.float64]


def parameter_estimates(
    plan: Plan, values: FloatArray, polish: LeastSquaresFit | None, judgement: Judgement
) -> dict[str, ParameterEstimate]:
    """Return every parameter's estimate, the fixed ones included, and the measurement chain's."""
    result = {}
    for j, parameter in enumerate(plan.parameters):
        status = judgement.statuses.get(parameter.name)
        error = None
        at_bound: Any = None
        if polish is not None:
            at_bound = {-1: "lower", 1: "upper"}.get(int(polish.at_bound[j]))
            raw = float(polish.standard_errors[j])
            is_told = np.isfinite(raw) and not (status and raw > NOTHING_TOLD * abs(values[j]))
            error = raw if is_told and at_bound is None else None
        else:
            width = parameter.upper - parameter.lower
            if values[j] - parameter.lower <= 1e-9 * width:
                at_bound = "lower"
            elif parameter.upper - values[j] <= 1e-9 * width:
                at_bound = "upper"
        result[parameter.name] = ParameterEstimate(
            name=parameter.name,
            value=float(values[j]),
            unit=parameter.unit,
            lower=parameter.lower,
            upper=parameter.upper,
            standard_error=error,
            at_bound=at_bound,
            status=status.status if status else "ok",
            reason=status.reason if status else None,
            nominal=parameter.nominal,
            settings=_settings(plan, parameter, float(values[j])),
        )
    for name, value in plan.fixed.items():
        variable = plan.binding.target(name)
        if variable.causality != "input":
            held = Parameter(name, variable.unit, value, value, log=False, targets=(name,))
            settings = _settings(plan, held, value)
            result[name] = ParameterEstimate(name, value, variable.unit, value, value, free=False, settings=settings)
    return result


def _settings(plan: Plan, parameter: Parameter, value: float) -> tuple[Setting, ...] | None:
    """Return what a parameter sets in the FMU; None where that is one variable of its own name, in SI."""
    if parameter.place is not None:
        return ()
    settings = []
    for name, gain in zip(parameter.targets, parameter.gains or (1.0,) * len(parameter.targets), strict=True):
        variable = plan.binding.target(name)
        own = (gain * value - variable.offset) / variable.factor
        kind = "Real" if variable.is_real else variable.type
        settings.append(Setting(name, own, variable.own_unit or variable.unit, kind))
    return None if settings == [Setting(parameter.name, value, parameter.unit)] else tuple(settings)


def sensors(plan: Plan, explained: Explained | None = None) -> dict[str, dict[str, Any]]:
    """Return the model of each output's sensor, as the case declares it and as it was found."""
    fit = None if explained is None else explained.fit
    known = {} if fit is None else dict(zip(fit.simulator.names, fit.values.tolist(), strict=True))
    result: dict[str, dict[str, Any]] = {}
    for name in plan.outputs:
        chain = plan.chains.get(name, ChainSpec())
        result[name] = {
            "sensor": "mean"
            if plan.sensors[name] == layout.MEAN or known.get(f"mean over the interval {name}")
            else "identity",
            "average": round(known.get(f"average {name}", 1.0)) * chain.average,
            "filters": [f.family for f in chain.filters],
            "gain": chain.gain,
            "offset": chain.offset,
            "delay": chain.delay,
        }
    return result


def recordings(plan: Plan) -> tuple[dict[str, Any], ...]:
    """Return what was done to each recording."""
    case = plan.case
    count = max(len(case.recordings), len(case.runs), len(plan.observed))
    runs = [run for run in map(case.run, range(count)) if not run.validate]
    return tuple(
        {
            "name": o.recording.name,
            "samples": len(o.recording.time),
            "missing_rows": o.recording.missing_rows,
            "even_clock": o.recording.even,
            **run_value(run),
        }
        for o, run in zip(plan.observed, runs, strict=False)
    )


def comparisons(plan: Plan, shown: list[FloatArray]) -> tuple[Comparison, ...]:
    """Return measured against simulated signals, one entry a recording; `shown` is (n, outputs) each."""
    return tuple(
        dataclasses.replace(alone, simulated={name: rows[:, j].copy() for j, name in enumerate(plan.outputs)})
        for alone, rows in zip(measured(plan), shown, strict=True)
    )


def measured(plan: Plan) -> tuple[Comparison, ...]:
    """Return the recordings alone, one entry each, where nothing was simulated."""
    return tuple(
        Comparison(
            name=o.recording.name,
            time=o.recording.time,
            inputs=dict(o.inputs),
            measured=dict(o.outputs),
            simulated={},
            units={n: plan.unit(n) for n in (*o.inputs, *o.outputs)},
        )
        for o in plan.observed
    )


def figures(plan: Plan, comparisons: tuple[Comparison, ...]) -> tuple[dict[str, float], dict[str, float]]:
    """Return root mean square error (SI) and fit (percent) of each output over all recordings."""
    rmse, fit = {}, {}
    for name in plan.outputs if comparisons else ():
        measured = np.concatenate([c.measured[name] for c in comparisons])
        simulated = np.concatenate([c.simulated[name] for c in comparisons])
        used = ~np.isnan(measured)
        error = simulated[used] - measured[used]
        spread = measured[used] - measured[used].mean()
        rmse[name] = float(np.sqrt(np.mean(error**2)))
        scale = float(np.linalg.norm(spread))
        fit[name] = 100 * (1 - float(np.linalg.norm(error)) / scale) if scale > 0 else float("nan")
    return rmse, fit


def correlation(polish: LeastSquaresFit) -> FloatArray:
    """Return the (p, p) correlation of the estimates; zero for parameters at a bound."""
    deviation = np.sqrt(np.diag(polish.covariance))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = polish.covariance / np.outer(deviation, deviation)
    correlation[~np.isfinite(correlation)] = 0.0
    np.fill_diagonal(correlation, 1.0)
    return np.asarray(np.clip(correlation, -1.0, 1.0))


def information(polish: LeastSquaresFit, names: tuple[str, ...]) -> dict[str, Any]:
    """Return eigenvalues of the Fisher information scaled to a diagonal of 1, and the direction of the least."""
    if not polish.jacobian.shape[1]:
        return {}
    r = triangle(polish.jacobian)
    if not r.any(axis=0).all() or not np.isfinite(r).all():
        return {}
    _, singular, rows = scaled_svd(r)
    return {
        "eigenvalues": np.sort(singular**2).tolist(),
        "least_told": dict(zip(names, rows[-1].tolist(), strict=True)),
    }


def versions() -> dict[str, str]:
    """Return the versions of the program and its libraries."""
    return dict(_versions())


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    import platform
    from importlib.metadata import PackageNotFoundError, version

    versions = {"python": platform.python_version()}
    for package in ("fmu-estimator", "fmpy", "numpy", "scipy"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return tuple(versions.items())
