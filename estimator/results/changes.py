"""What changed between estimates: differences with joint standard errors, a threshold, repeatability. Runs nothing.

The first result is the reference. With recordings of their own two estimates' errors are independent, and a difference
has the variance σ_a² + σ_b². Of n tests each is made at the level 1 − (1 − α)^(1/n) (Šidák 1967), so that among results
that do not differ one test or more fires with a probability of at most α. Beside every quantity for itself all free
parameters are tested together: dᵀ (Σ_a + Σ_b)⁻¹ d is chi-square distributed with their number of degrees.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from estimator.conventions import USELESS_ERROR
from estimator.distributions import chi_square_beyond
from estimator.errors import InputError
from estimator.results.result import Estimate, FloatArray, ParameterEstimate

FALSE_CHANGE = 0.01  # of one comparison as a whole
OF_WINDING = ("kA",)  # derived quantities with a part of the inductance, where it is told
FEWEST = 3  # results that have a repeatability


@dataclass(frozen=True)
class Change:
    """How one quantity of one result differs from that of the reference.

    Attributes
    ----------
    difference, standard_error : in the quantity's unit
    percent, percent_error : of the reference's value
    z : difference over its standard error, what is tolerated taken off
    """

    result: str
    difference: float
    standard_error: float
    percent: float
    percent_error: float
    z: float
    differs: bool


@dataclass(frozen=True)
class Repeatability:
    """How far several results scatter, against what their standard errors say.

    Attributes
    ----------
    mean, deviation : of the values, in the unit
    percent : deviation over mean
    ratio : deviation over the root mean square of the standard errors
    probability : of so much scatter or more, if the standard errors were all
    """

    mean: float
    deviation: float
    percent: float
    ratio: float
    probability: float


@dataclass(frozen=True)
class Quantity:
    """One quantity in all results that have it with a standard error.

    Attributes
    ----------
    kind : "parameter" or "derived"
    values : result → (value, standard error)
    changes : one a result but the reference
    """

    name: str
    unit: str
    kind: str
    values: Mapping[str, tuple[float, float]]
    changes: tuple[Change, ...]
    repeatability: Repeatability | None


@dataclass(frozen=True)
class Joint:
    """All free parameters of one result against the reference's at once."""

    result: str
    chi_square: float
    degrees: int
    probability: float
    differs: bool


@dataclass(frozen=True)
class Changes:
    """What differs between results.

    Attributes
    ----------
    results : names, the reference first
    threshold : standard errors beyond which one quantity differs
    tests : number of tests that share the false alarm rate
    notes : what could not be compared, and what else is not alike
    """

    results: tuple[str, ...]
    false_alarm: float
    within: float
    threshold: float
    tests: int
    quantities: tuple[Quantity, ...]
    joint: tuple[Joint, ...]
    notes: tuple[str, ...]

    @property
    def differing(self) -> dict[str, list[str]]:
        """Result → quantities that differ from the reference's; "all parameters together" for the joint test."""
        found: dict[str, list[str]] = {}
        for quantity in self.quantities:
            for change in quantity.changes:
                if change.differs:
                    found.setdefault(change.result, []).append(quantity.name)
        for joint in self.joint:
            if joint.differs and joint.result not in found:
                found[joint.result] = ["all parameters together"]
        return found


def changes(results: Mapping[str, Estimate], *, false_alarm: float = FALSE_CHANGE, within: float = 0.0) -> Changes:
    """Compare results with the first of them.

    Parameters
    ----------
    results : name → Estimate, the reference first; two or more
    false_alarm : probability that anything is said to differ where nothing does
    within : percent of the reference's value by which a quantity may differ all the same

    Raises
    ------
    InputError
        There is nothing that could be compared.
    """
    names = tuple(results)
    for name, estimate in results.items():
        if estimate.verdict == "refused" or not estimate.parameters:
            why = estimate.reasons[0] if estimate.reasons else "it has no parameters"
            raise InputError(f"{name} was refused, so there is nothing to compare: {why}")
    known = {name: _known(estimate) for name, estimate in results.items()}
    if not _is_one_winding(results):
        known = {name: {key: v for key, v in told.items() if key[0] not in OF_WINDING} for name, told in known.items()}
    first = known[names[0]]
    shared = [key for key in first if any(key in known[name] for name in names[1:])]
    pairs = sum(key in known[name] for key in shared for name in names[1:])
    if not pairs:
        raise InputError(
            f"{' and '.join(names)} have no quantity in common that both determine with a standard error; give"
            " results of one method and one model"
        )
    joint_of = {name: _joint(results[names[0]], results[name]) for name in names[1:]} if within == 0 else {}
    tests = pairs + sum(found is not None for found in joint_of.values())
    level = 1 - (1 - false_alarm) ** (1 / tests)
    threshold = NormalDist().inv_cdf(1 - level / 2)
    quantities = []
    for key in shared:
        name, kind, unit = key
        values = {n: known[n][key] for n in names if key in known[n]}
        every = tuple(
            _change(n, values[names[0]], values[n], threshold=threshold, within=within)
            for n in names[1:]
            if n in values
        )
        quantities.append(Quantity(name, unit, kind, values, every, _repeatability(list(values.values()))))
    joint = tuple(
        Joint(name, chi, degrees, p, p < level)
        for name, found in joint_of.items()
        if found is not None
        for chi, degrees, p in (found,)
    )
    notes = tuple(_notes(results))
    return Changes(names, false_alarm, within, threshold, tests, tuple(quantities), joint, notes)


def _known(estimate: Estimate) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Return (name, kind, unit) → value and standard error of what an estimate determines."""
    found: dict[tuple[str, str, str], tuple[float, float]] = {}
    for name, p in estimate.parameters.items():
        if _is_told(p):
            found[name, "parameter", p.unit] = (p.value, float(p.standard_error or 0.0))
    for name, q in estimate.derived.items():
        if 0 < q.standard_error < USELESS_ERROR * abs(q.value):
            found[name.replace("_", " "), "derived", q.unit] = (q.value, q.standard_error)
    return found


def _is_one_winding(results: Mapping[str, Estimate]) -> bool:
    """Whether all results determine the inductance, or none: what holds a part of it means the same in each."""
    told = [("L" in e.parameters and _is_told(e.parameters["L"])) for e in results.values()]
    return all(told) or not any(told)


def _is_told(p: ParameterEstimate) -> bool:
    error = p.standard_error
    return p.free and p.status != "not identified" and error is not None and 0 < error < math.inf


def _change(name: str, a: tuple[float, float], b: tuple[float, float], *, threshold: float, within: float) -> Change:
    difference = b[0] - a[0]
    error = math.hypot(a[1], b[1])
    scale = abs(a[0]) / 100 or math.nan
    beyond = max(abs(difference) - within * abs(a[0]) / 100, 0.0)
    z = math.copysign(beyond / error, difference)
    return Change(name, difference, error, difference / scale, error / scale, z, abs(z) > threshold)


def _joint(a: Estimate, b: Estimate) -> tuple[float, int, float] | None:
    """Return chi-square, degrees of freedom and probability of all parameters that both determine; None if too few."""
    one, other = _covariance(a), _covariance(b)
    if one is None or other is None:
        return None
    names = [n for n in one[0] if n in other[0] and a.parameters[n].unit == b.parameters[n].unit]
    if len(names) < 2:
        return None
    pick = [np.ix_([known.index(n) for n in names], [known.index(n) for n in names]) for known, _ in (one, other)]
    scale = np.array([abs(a.parameters[n].value) or 1.0 for n in names])
    covariance = (one[1][pick[0]] + other[1][pick[1]]) / np.outer(scale, scale)
    difference = np.array([b.parameters[n].value - a.parameters[n].value for n in names]) / scale
    values, vectors = np.linalg.eigh(covariance)
    seen = values > 1e-12 * values[-1]
    chi = float(np.sum((vectors[:, seen].T @ difference) ** 2 / values[seen]))
    return chi, int(seen.sum()), chi_square_beyond(int(seen.sum()), chi)


def _covariance(estimate: Estimate) -> tuple[list[str], FloatArray] | None:
    """Return names and covariance of what an estimate determines; None without its correlations."""
    if estimate.correlation is None:
        return None
    names = [n for n in estimate.correlated if n in estimate.parameters and _is_told(estimate.parameters[n])]
    at = [estimate.correlated.index(n) for n in names]
    errors = np.array([estimate.parameters[n].standard_error for n in names], dtype=float)
    covariance = estimate.correlation[np.ix_(at, at)] * np.outer(errors, errors)
    return (names, covariance) if names and np.isfinite(covariance).all() else None


def _repeatability(values: Sequence[tuple[float, float]]) -> Repeatability | None:
    """Return the scatter of three values and more; its probability by the chi-square of the weighted deviations."""
    if len(values) < FEWEST:
        return None
    x, errors = (np.array(column) for column in zip(*values, strict=True))
    weights = 1 / errors**2
    weighted = float(np.sum(weights * x) / np.sum(weights))
    mean, deviation = float(x.mean()), float(x.std(ddof=1))
    probability = chi_square_beyond(len(x) - 1, float(np.sum(weights * (x - weighted) ** 2)))
    percent = 100 * deviation / abs(mean) if mean else math.nan
    return Repeatability(mean, deviation, percent, deviation / float(np.sqrt(np.mean(errors**2))), probability)


def _notes(results: Mapping[str, Estimate]) -> list[str]:
    """Return what was not compared, and what else is not alike."""
    notes = []
    (reference, first), *others = results.items()
    if not _is_one_winding(results) and any(name in e.derived for e in results.values() for name in OF_WINDING):
        notes.append(f"not all determine L, so {', '.join(OF_WINDING)} holds its part in some only: not compared")
    for name, estimate in results.items():
        if estimate.verdict == "doubtful":
            notes.append(f"{name} is doubtful: {estimate.reasons[0] if estimate.reasons else 'no reason is given'}")
        untold = [n for n, p in estimate.parameters.items() if p.free and not _is_told(p)]
        if untold:
            notes.append(f"{name} does not determine {', '.join(untold)}: not compared")
        held = {n: p.value for n, p in estimate.parameters.items() if not p.free}
        if held:
            notes.append(f"{name} holds {', '.join(f'{n} = {v:.6g}' for n, v in held.items())} fixed: not compared")
    for name, estimate in others:
        for what, a, b in (
            ("FMU", first.fmu.get("name"), estimate.fmu.get("name")),
            ("method", first.method, estimate.method),
        ):
            if a != b:
                notes.append(f"{what}: {a} in {reference}, {b} in {name}; a parameter may mean something else in each")
        same = {str(r.get("name")) for r in first.recordings} & {str(r.get("name")) for r in estimate.recordings}
        if same:
            notes.append(
                f"{reference} and {name} both come from a recording named {', '.join(sorted(same))}: if it is the same"
                " one, their errors are not independent and these bars are too long"
            )
    return notes
