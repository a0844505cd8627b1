"""Variance of each parameter from run to run: a random effect, from a joint fit's blocks. Knows arrays, no FMU.

Let z be the whitened residuals of the joint fit, J its Jacobian, and let recording r have a value of its own, t + d_r,
of one parameter, the others shared. Let X be the parameter's column cut into recordings, and M the projection that
removes what the others explain. S = X'MX and u = X'Mz then determine all d_r; the common value is projected out. If
the d_r are independent of variance T^2, u has the covariance S + T^2 S S, so that

    Q = u' S^+ u,    E Q = rank S + T^2 tr S,    T^2 = max(0, (Q - rank S) / tr S)

(DerSimonian and Laird 1986, with the estimates of the recordings correlated through what they share). Without T, Q is
chi-square. Parameters enter one after the other, the least likely Q first, each tested beside those that entered
before, so that the change of one is not taken for a change of all; those whose d_r the answer has enter first. The
joint answer t = sum_r A^-1 H_r t_r, H_r = J_r'J_r and A their sum, then gains the variance T^2 sum_r (A^-1 H_r e)(A^-1
H_r e)'. Where the d_r are estimated, too, as deviations from their mean, t is the mean of k runs, T^2 / k its variance,
and they move nothing else. Of a variation that is told it is as many times as large as two standard deviations of so
few runs ask for: Student's t of rank S degrees over that of many (GUM, JCGM 100:2008, G.4.1).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import FALSE_ALARM
from estimator.distributions import chi_square_beyond, f_limit, normal_quantile
from estimator.fitting.information import RANK_TOLERANCE, information_parts

if TYPE_CHECKING:
    from estimator.fitting.fit import Fit

FloatArray = NDArray[np.float64]

BETWEEN = " between runs"  # ends the name of a recording's own part of a parameter
ENTERS = 0.05  # chance that a variance is added to the standard errors though nothing varies, all parameters together
OUTSIDE = 0.05  # of what is outside of two standard errors
FAR_APART = 100.0  # times as large, as much above: further apart it is not told by how much
LEAST_INFORMATION = 1e-8  # of the largest information: recordings, or contrasts of them, with less are not used


@dataclass(frozen=True)
class Variation:
    """How one parameter varies between runs.

    Attributes
    ----------
    parameter : index of the parameter
    deviation : float
        T, on the parameter's scale.
    errors : float
        T over the standard error that one run has beside the others.
    probability : float
        Of a larger Q where nothing changes.
    told : bool
        It is below FALSE_ALARM, shared by the parameters.
    freedom : rank S, the degrees of freedom that tell it: one less than there are runs
    run, apart : which recording is furthest from the rest, in its errors, and by how much on the parameter's scale
    """

    parameter: int
    deviation: float
    errors: float
    probability: float
    told: bool
    freedom: int
    run: int
    apart: float

    @property
    def widened(self) -> float:
        """How many times as large its part of a bar is as that of many runs would be, for the same coverage."""
        if not self.told:
            return 1.0
        return float(np.sqrt(f_limit(1, self.freedom, OUTSIDE)) / normal_quantile(1 - OUTSIDE / 2))


@dataclass(frozen=True)
class BetweenRuns:
    """The parameters that vary between runs, and the covariance, (n, n), that this adds to the joint answer."""

    variations: tuple[Variation, ...]
    covariance: FloatArray


def between_runs(
    jacobian: FloatArray,
    residuals: FloatArray,
    runs: Sequence[slice],
    *,
    tested: Sequence[int],
    estimated: Sequence[int] = (),
    shared: FloatArray | None = None,
) -> BetweenRuns:
    """Return what varies between the runs of a joint fit.

    Parameters
    ----------
    jacobian : (m, n) array
        Whitened derivatives of what is explained.
    residuals : (m,) array
        Whitened, measured less explained, at the joint optimum.
    runs : rows of each recording
    tested : columns of the parameters that may vary
    estimated : those of them whose deviations in each run the answer has
    shared : (m, k) array, optional
        What errors of variance 1 that runs share add to the residuals, which the Jacobian is not whitened for.
    """
    n = jacobian.shape[1]
    if len(runs) < 2 or not len(tested):
        return BetweenRuns((), np.zeros((n, n)))
    shared = np.zeros((len(jacobian), 0)) if shared is None else shared
    many = n + shared.shape[1]
    wide = np.column_stack([jacobian, shared, residuals])
    blocks = [np.linalg.qr(wide[part], mode="r") for part in runs]
    edges = np.cumsum([0, *(len(b) for b in blocks)])
    rows = [slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    whole = np.concatenate([*blocks, np.eye(many + 1)[n:many]])  # the shared errors' coefficients, known to be about 0
    matrix, z = whole[:, :many], whole[:, many]
    varying: list[Variation] = []
    for group in (estimated, [j for j in tested if j not in estimated]):
        remaining = list(group)
        while remaining:
            found = []
            for j in remaining:
                own = [_cut(matrix[:, v.parameter], rows) for v in varying]
                others = [k for k in range(many) if k != j and k not in [v.parameter for v in varying]]
                one = _variation(j, _cut(matrix[:, j], rows), np.column_stack([matrix[:, others], *own]), z)
                found += [one] if one is not None else []
            best = min(found, key=lambda f: (f[0].probability, -f[1]), default=None)
            if best is None or best[0].probability * len(tested) > ENTERS or best[0].deviation == 0:
                break
            told = best[0].probability * len(tested) < FALSE_ALARM
            varying.append(dataclasses.replace(best[0], told=told))
            remaining.remove(best[0].parameter)
    covariance = np.zeros((many, many))
    if varying:
        inverse = information_parts(matrix)[0]
        for v in varying:
            if v.parameter in estimated:
                covariance[v.parameter, v.parameter] += (v.deviation * v.widened) ** 2 / len(rows)
                continue
            for part in rows:
                pull = inverse @ (matrix[part].T @ matrix[part, v.parameter])
                covariance += (v.deviation * v.widened) ** 2 * np.outer(pull, pull)
    return BetweenRuns(tuple(varying), covariance[:n, :n])


def _cut(column: FloatArray, rows: Sequence[slice]) -> FloatArray:
    """Return a column cut into its recordings, (m, k)."""
    result = np.zeros((len(column), len(rows)))
    for r, part in enumerate(rows):
        result[part, r] = column[part]
    return result


def _variation(j: int, own: FloatArray, others: FloatArray, z: FloatArray) -> tuple[Variation, float] | None:
    """Return a parameter's variation and Q; None where fewer than two recordings tell it."""
    basis = _basis(others)
    across = own - basis @ (basis.T @ own)
    information, score = across.T @ across, across.T @ z
    total = float(np.sum(information))
    powers = np.sum(own * own, axis=0)
    if np.sum(powers > LEAST_INFORMATION * np.max(powers)) < 2 or total <= LEAST_INFORMATION * float(np.sum(powers)):
        return None
    mean = information.sum(axis=1)
    information = information - np.outer(mean, mean) / total
    score = score - mean * float(np.sum(score)) / total
    eigen, vectors = np.linalg.eigh(information)
    seen = eigen > LEAST_INFORMATION * float(np.max(powers))
    rank = int(np.sum(seen))
    if not rank:
        return None
    q = float(np.sum((vectors[:, seen].T @ score) ** 2 / eigen[seen]))
    size = float(np.sum(eigen[seen]))
    variance = max(0.0, (q - rank) / size)
    known = np.maximum(np.diag(information), 1e-300)
    tells = np.diag(information) > LEAST_INFORMATION * float(np.max(powers))
    off = np.where(tells, np.abs(score) / np.sqrt(known), 0.0)
    run = int(np.argmax(off))
    deviation = float(np.sqrt(variance))
    errors = deviation * float(np.sqrt(size / rank))
    probability = chi_square_beyond(rank, q)
    return Variation(j, deviation, errors, probability, False, rank, run, float(score[run] / known[run])), q


def _basis(columns: FloatArray) -> FloatArray:
    """Return an orthonormal basis of what columns explain."""
    norms = np.linalg.norm(columns, axis=0)
    columns = columns[:, norms > 0] / norms[norms > 0]
    if not columns.shape[1]:
        return np.zeros((len(columns), 0))
    u, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(u[:, singular > RANK_TOLERANCE * singular[0]])


def of_fit(fit: Fit, parameters: int) -> BetweenRuns:
    """Return what varies between the recordings of a fit, of its first names, the motor's parameters.

    Deviations that an explanation estimates for each recording (effects/runs_differ.py) count as variation.
    """
    if len(fit.simulator.clocks) < 2:
        return BetweenRuns((), np.zeros((len(fit.at_bound), len(fit.at_bound))))
    own = np.array([is_between_runs(name) for name in fit.names])
    inside = np.flatnonzero((fit.at_bound == 0) & ~own)
    z = fit.z + fit.jacobian[:, own] @ fit.estimates[own]  # as if the runs were alike
    q = fit.shown.shape[1]
    runs = [slice(c.rows.start * q, c.rows.stop * q) for c in fit.simulator.clocks]
    tested = [k for k, j in enumerate(inside.tolist()) if j < parameters]
    stems = np.array([name.partition("#")[0] for name in fit.names])
    jacobian, estimated = fit.jacobian[:, inside], []
    for k in tested:
        of_runs = fit.jacobian[:, stems == f"{fit.names[inside[k]]}{BETWEEN}"]
        if of_runs.shape[1]:  # secants: a large deviation is explained by them, not by derivatives
            estimated.append(k)
            for r, rows in enumerate(runs):
                jacobian[rows, k] = of_runs[rows, r] if r < of_runs.shape[1] else -of_runs[rows, 0]
    white, shared = fit.whitener.by_noise_alone(np.column_stack([jacobian, z]))
    found = between_runs(white[:, :-1], white[:, -1], runs, tested=tested, estimated=estimated, shared=shared)
    covariance = np.zeros((len(fit.at_bound), len(fit.at_bound)))
    covariance[np.ix_(inside, inside)] = found.covariance
    variations = tuple(dataclasses.replace(v, parameter=int(inside[v.parameter])) for v in found.variations)
    return BetweenRuns(variations, covariance)


def is_between_runs(name: str) -> bool:
    """Whether a name of a fit is a recording's deviation of a parameter from the mean of all."""
    return name.partition("#")[0].endswith(BETWEEN)


def sentence(v: Variation, *, name: str, unit: str, is_log: bool, runs: Sequence[str]) -> str:
    """Say how a parameter varies between the recordings `runs`."""
    size = f"{100 * v.deviation:.2g} %" if is_log else f"{v.deviation:.2g} {unit}".rstrip()
    apart = min(float(np.expm1(min(v.apart, FAR_APART))), FAR_APART)
    more = " and more" if apart == FAR_APART else ""
    away = f"{100 * abs(apart):.2g} %{more}" if is_log else f"{abs(v.apart):.2g} {unit}".rstrip()
    rest = next(r for k, r in enumerate(runs) if k != v.run) if len(runs) == 2 else "the others"
    return (
        f"between runs {name} varies by {size} ({v.errors:.1f} standard errors of one run):"
        f" {runs[v.run]} has it {away} {'above' if v.apart > 0 else 'below'} {rest}"
    )
