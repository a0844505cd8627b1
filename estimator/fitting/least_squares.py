"""Weighted least squares from a start: values, covariance, what is not determined. Knows residuals, no motor, no FMU.

    minimise  Σ_j Σ_k (y_jk(θ) − m_jk)² / σ_j²        over x = ln θ (or θ, for parameters not on a log scale)

by the trust-region reflective method (trust_region.py) with a Jacobian of one-sided differences, all of whose
simulations are one batch. σ_j are the residuals' own deviations: found from the fit and put back, until they agree (for
independent normal noise of unknown deviations this is the maximum-likelihood estimate). The covariance at the optimum
is (JᵀJ)⁻¹ with a Jacobian of central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import HUBER, MEDIAN_SIZE
from estimator.fitting.trust_region import steps
from estimator.plans.parameters import Box

if TYPE_CHECKING:
    from estimator.plans.plan import Plan

FloatArray = NDArray[np.float64]
Residuals = Callable[[FloatArray], FloatArray]

DIFFERENCE_STEP = 1e-4  # of a parameter, or added to its logarithm, for differences
TOGETHER = 2_000_000  # residuals that are simulated at once for several fits
REWEIGHTINGS = 3
REWEIGHTED = 0.02  # relative change of the deviations at which reweighting stops
CLOSE, CLOSINGS = 0.02, 3  # of chi-square: an optimum no further above the least is accepted; attempts to come closer
ROUNDING = 1e-12  # of a signal's deviation: rounding of a simulation
NOISE_FREE = 1e-7  # of a signal's deviation: smaller residuals are numerical, not noise
FAILED_RESIDUAL = 1e3  # what a failed simulation shows, in deviations
RANK_TOLERANCE = 1e-6  # of the largest singular value: smaller ones are the numerical noise of differences
OUTSIDE = 1e-3  # of a unit vector, in directions not determined: a smaller part is rounding
AT_BOUND = 1e-6  # of the scaled width of the bounds


@dataclass(frozen=True)
class LeastSquaresFit:
    """A least-squares optimum.

    Attributes
    ----------
    values : (p,) array
        Parameters, in their units.
    cost : float
        Σ of squared weighted residuals.
    deviations : (q,) array
        σ of each output, in its unit.
    covariance : (p, p) array
        Of the scaled parameters (ln θ where log); rows of parameters at a bound are zero.
    standard_errors : (p,) array
        In the parameters' units; infinity where not determined, 0 at a bound.
    at_bound : (p,) array
        −1 lower, 1 upper, 0 free.
    jacobian : (m, p) array
        Of the weighted residuals by the scaled parameters.
    residuals : (m,) array
        Weighted.
    scores : (p, p) array
        Jᵀ Γ J, with Γ the autocovariance of the weighted residuals; JᵀJ where they are white. The covariance between
        its inverses (JᵀJ)⁻¹.
    """

    values: FloatArray
    cost: float
    deviations: FloatArray
    covariance: FloatArray
    standard_errors: FloatArray
    at_bound: NDArray[np.int64]
    jacobian: FloatArray
    residuals: FloatArray
    scores: FloatArray


class LeastSquares:
    """A least-squares problem.

    Parameters
    ----------
    residuals : callable
        (c, p) candidates in the parameters' units → (c, m) residuals in the outputs' units; a failed candidate's
        row is NaN.
    box : Box
        Bounds and scales of the parameters.
    output : (m,) integer array
        Which output each residual belongs to.
    spread : (q,) array
        Standard deviation of each measured output: its scale.
    loss : "linear" or "huber"
        Beyond HUBER deviations a residual counts in proportion, no longer by its square (Huber 1964).
    """

    def __init__(
        self,
        residuals: Residuals,
        box: Box,
        *,
        output: NDArray[np.int64],
        spread: FloatArray,
        loss: str = "linear",
    ) -> None:
        self._robust = loss == "huber"
        self._residuals, self.box, self._output, self._spread = residuals, box, output, spread
        self.low = _scale(box.lower, box.log)
        self.high = _scale(box.upper, box.log)

    def fit(
        self,
        start: FloatArray,
        deviations: FloatArray,
        *,
        evaluations: int = 40,
        tolerance: float = 1.0,
        central: bool = False,
    ) -> tuple[FloatArray, float]:
        """Return the optimum, (p,) in the parameters' units, and its cost, for given deviations of the outputs."""
        return self.fits([start], deviations, evaluations=evaluations, tolerance=tolerance, central=central)[0]

    def fits(
        self,
        starts: Sequence[FloatArray],
        deviations: FloatArray,
        *,
        evaluations: int = 40,
        tolerance: float = 1.0,
        central: bool = False,
    ) -> list[tuple[FloatArray, float]]:
        """Return what `fit` does of every start; what they ask for is simulated together, step by step."""
        many = max(1, TOGETHER // (len(self._output) * self.box.dimension))
        found: list[tuple[FloatArray, float]] = []
        for part in (starts[k : k + many] for k in range(0, len(starts), many)):
            asking = [self._fit(s, deviations, evaluations, tolerance, central=central) for s in part]
            ends: dict[int, tuple[FloatArray, float]] = {}
            answers: list[FloatArray | None] = [None] * len(part)
            while len(ends) < len(part):
                asked: dict[int, FloatArray] = {}
                for k, fit in enumerate(asking):
                    if k not in ends:
                        try:
                            asked[k] = fit.send(answers[k])  # type: ignore[arg-type]
                        except StopIteration as end:
                            ends[k] = end.value
                if asked:
                    raw = self._residuals(np.concatenate(list(asked.values())))
                    edges = np.cumsum([0, *(len(points) for points in asked.values())])
                    for k, first, last in zip(asked, edges[:-1], edges[1:], strict=True):
                        answers[k] = raw[first:last]
            found += [ends[k] for k in range(len(part))]
        return found

    def _fit(
        self, start: FloatArray, deviations: FloatArray, evaluations: int, tolerance: float, *, central: bool
    ) -> Generator[FloatArray, FloatArray, tuple[FloatArray, float]]:
        """Yield candidates, (c, p) in their units, whose residuals are asked; return the optimum and its cost."""
        weights = 1 / deviations[self._output]
        margin = 1e-9 * (self.high - self.low)
        x = np.clip(_scale(start, self.box.log), self.low + margin, self.high - margin)
        free = self.high > self.low
        if not free.any():
            own = self._weighed((yield self._values(x)[None, :]), weights)[0]
            own = rooted(own)[0] if self._robust else own
            return np.array(start), float(own @ own)
        asking = steps(
            x,
            low=self.low,
            high=np.where(free, self.high, self.low + 1e-12),
            evaluations=evaluations,
            ftol=1e-14 * tolerance,
            xtol=1e-11 * tolerance,
        )
        known: dict[bytes, FloatArray] = {}
        x, slope = next(asking)
        while True:
            if slope:
                at = known[x.tobytes()]
                raw = yield self._beside(x, central=central)
                answer = self._slopes(raw, x, weights, at, central=central)
                answer = answer * rooted(at)[1][:, None] if self._robust else answer
            else:
                at = self._weighed((yield self._values(x)[None, :]), weights)[0]
                known = {x.tobytes(): at}
                answer = rooted(at)[0] if self._robust else at
            try:
                x, slope = asking.send(answer)
            except StopIteration as end:
                found, cost = end.value
                return self._values(found), cost

    def quick(self, start: FloatArray, deviations: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return values and deviations of a rough fit, enough to compare models."""
        values, _ = self.fit(start, deviations, evaluations=10, tolerance=1e6)
        return values, self.deviations(values, free=self.box.dimension)

    def deviations(self, values: FloatArray, *, free: int) -> FloatArray:
        """Return the residuals' deviations of each output at a point; `free` parameters cost degrees of freedom."""
        return self.deviations_of([values], free=free)[0]

    def deviations_of(self, points: Sequence[FloatArray], *, free: int) -> list[FloatArray]:
        """Return the same of several points."""
        many = max(1, TOGETHER // len(self._output))
        parts = [np.array(points[k : k + many]) for k in range(0, len(points), many)]
        return [self._deviations(raw, free) for part in parts for raw in self._residuals(part)]

    def _deviations(self, raw: FloatArray, free: int) -> FloatArray:
        outputs = len(self._spread)
        result = np.empty(outputs)
        for j in range(outputs):
            own = raw[self._output == j]
            own = own[np.isfinite(own)]
            if self._robust and own.any():
                result[j] = float(np.median(np.abs(own[own != 0]))) / MEDIAN_SIZE
                continue
            freedom = max(1.0, len(own) - free / outputs)
            result[j] = np.sqrt(own @ own / freedom) if len(own) else self._spread[j]
        return np.maximum(result, ROUNDING * self._spread)

    def polish(self, start: FloatArray, deviations: FloatArray) -> LeastSquaresFit:
        """Fit, estimate the deviations from the residuals, and repeat until they agree."""
        values, cost = self.fit(start, deviations)
        for _ in range(REWEIGHTINGS):
            found = self.deviations(values, free=self.box.dimension)
            if np.all(found < NOISE_FREE * self._spread):
                deviations = found
                break
            floored = np.maximum(found, NOISE_FREE * self._spread)
            change = np.max(np.abs(floored / deviations - 1))
            # Only ratios of the deviations move the optimum; a common factor does not.
            ratio = floored / deviations
            moved = np.max(ratio) / np.min(ratio) - 1
            deviations = floored
            if moved > REWEIGHTED:
                values, cost = self.fit(values, deviations)
            elif change <= REWEIGHTED or moved <= REWEIGHTED:
                break
        return self._closed_in(self.judge(values, deviations))

    def _closed_in(self, found: LeastSquaresFit) -> LeastSquaresFit:
        """Continue with central differences if their Jacobian shows that the minimum is not reached.

        One-sided differences distort the gradient along a narrow valley. Encoder counts make such valleys: they
        determine some combination of the parameters a thousand times better than another.
        """
        for _ in range(0 if self._robust else CLOSINGS):
            inside = found.jacobian[:, found.at_bound == 0]
            noisy = np.any(found.deviations > NOISE_FREE * self._spread)
            if not noisy or not inside.shape[1] or not np.isfinite(inside).all():
                break
            along = np.linalg.qr(inside)[0].T @ found.residuals
            if float(along @ along) < CLOSE:
                break
            values, cost = self.fit(found.values, found.deviations, evaluations=15, central=True)
            if not cost < found.cost:
                break
            deviations = np.maximum(self.deviations(values, free=self.box.dimension), NOISE_FREE * self._spread)
            found = self.judge(values, deviations)
        return found

    def judge(self, values: FloatArray, deviations: FloatArray) -> LeastSquaresFit:
        """Return covariance and standard errors at a point, for given deviations of the outputs."""
        weights = 1 / deviations[self._output]
        x = _scale(values, self.box.log)
        width = np.where(self.high > self.low, self.high - self.low, 1.0)
        at_bound = np.where(x - self.low <= AT_BOUND * width, -1, np.where(self.high - x <= AT_BOUND * width, 1, 0))
        residuals = self._weighted(x[None, :], weights)[0]
        jacobian = self._differences(x, weights, residuals, central=True)
        inside = at_bound == 0
        p = len(values)
        covariance = np.zeros((p, p))
        covariance[np.ix_(inside, inside)] = sum(information_parts(jacobian[:, inside]))
        wider = 1.0
        if self._robust:
            clipped = np.clip(residuals, -HUBER, HUBER)
            share = max(float(np.mean(np.abs(residuals) < HUBER)), 1e-3)
            power = float(np.mean(clipped**2))
            wider = power / share**2  # of an M-estimate (Huber 1964)
            covariance *= wider
            residuals = clipped * (share / power) if power > 0 else clipped
        with np.errstate(invalid="ignore"):
            errors = np.sqrt(np.diag(covariance)) * np.where(self.box.log, values, 1.0)
        return LeastSquaresFit(
            values=values,
            cost=float(residuals @ residuals),
            deviations=deviations,
            covariance=covariance,
            standard_errors=errors,
            at_bound=at_bound.astype(np.int64),
            jacobian=jacobian,
            residuals=residuals,
            scores=wider * jacobian.T @ jacobian,
        )

    def _values(self, x: FloatArray) -> FloatArray:
        values = np.where(self.box.log, np.exp(np.where(self.box.log, x, 0.0)), x)
        return np.clip(values, self.box.lower, self.box.upper)

    def _weighted(self, points: FloatArray, weights: FloatArray) -> FloatArray:
        return self._weighed(self._residuals(np.array([self._values(x) for x in points])), weights)

    def _weighed(self, raw: FloatArray, weights: FloatArray) -> FloatArray:
        """Return residuals, (c, m), over their deviations; large ones where the simulation failed."""
        weighted = raw * weights
        failed = ~np.isfinite(weighted).all(axis=1)
        weighted[failed] = FAILED_RESIDUAL
        return np.asarray(weighted)

    def _differences(self, x: FloatArray, weights: FloatArray, at: FloatArray, *, central: bool = False) -> FloatArray:
        return self._slopes(self._residuals(self._beside(x, central=central)), x, weights, at, central=central)

    def _forward(self, x: FloatArray) -> FloatArray:
        """Return the steps of differences, (p,): ahead, or back where a bound is near."""
        steps = DIFFERENCE_STEP * np.where(self.box.log, 1.0, np.maximum(np.abs(x), 1e-3 * (self.high - self.low)))
        return np.asarray(np.where(x + steps <= self.high, 1.0, -1.0) * steps)

    def _beside(self, x: FloatArray, *, central: bool) -> FloatArray:
        """Return the candidates, (p, p) or (2 p, p), that differences at x need."""
        moved = np.diag(self._forward(x))
        return np.array([self._unclipped(point) for point in (*(x + moved), *(x - moved if central else ()))])

    def _slopes(
        self, raw: FloatArray, x: FloatArray, weights: FloatArray, at: FloatArray, *, central: bool
    ) -> FloatArray:
        """Return the derivatives of the weighted residuals, (m, p), from those of `_beside`."""
        p, forward = len(x), self._forward(x)
        raw = raw * weights
        ahead = raw[:p]
        behind = raw[p:] if central else np.broadcast_to(at, ahead.shape)
        differences = ahead - behind
        if np.isfinite(differences).all():
            return np.ascontiguousarray((differences / (forward * (2.0 if central else 1.0))[:, None]).T)
        columns = []
        for j in range(p):
            good_ahead, good_behind = np.isfinite(ahead[j]).all(), np.isfinite(behind[j]).all()
            if good_ahead and good_behind:
                columns.append((ahead[j] - behind[j]) / (forward[j] * (2.0 if central else 1.0)))
            elif good_ahead:
                columns.append((ahead[j] - at) / forward[j])
            elif good_behind and central:
                columns.append((at - behind[j]) / forward[j])
            else:
                columns.append(np.zeros_like(at))
        return np.column_stack(columns)

    def _unclipped(self, x: FloatArray) -> FloatArray:
        """Return values that may lie one difference step outside the bounds."""
        return np.where(self.box.log, np.exp(np.where(self.box.log, x, 0.0)), x)


def rooted(residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals, (m,), whose squares are twice Huber's loss, and their derivatives by the plain ones."""
    size = np.abs(residuals)
    far = size > HUBER
    root = np.sqrt(np.where(far, 2 * HUBER * size - HUBER**2, 1.0))
    return np.where(far, np.sign(residuals) * root, residuals), np.where(far, HUBER / root, 1.0)


def _scale(values: FloatArray, log: NDArray[np.bool_]) -> FloatArray:
    return np.where(log, np.log(np.where(log, values, 1.0)), values)


def information_parts(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (JᵀJ)⁻¹ in two parts, (p, p) each: of the directions that the data determine, and of the others.

    A direction is determined if its singular value, of the column-scaled Jacobian, is above RANK_TOLERANCE of the
    largest: below, the differences that the Jacobian is made of are noise. The second part is zero for parameters that
    lie in what is seen, and infinite where a column is zero.
    """
    scale, singular, rows = scaled_svd(jacobian)
    if not len(scale):
        return np.zeros((0, 0)), np.zeros((0, 0))
    floor = max(jacobian.shape) * np.finfo(float).eps * singular[0]
    inverse = 1 / np.maximum(singular, max(floor, 1e-150)) ** 2
    seen = singular > RANK_TOLERANCE * singular[0]

    def part(which: NDArray[np.bool_]) -> FloatArray:
        return np.asarray((rows[which].T * inverse[which]) @ rows[which] / np.outer(scale, scale))

    unseen = part(~seen)
    outside = np.linalg.norm(rows[~seen], axis=0) > OUTSIDE
    unseen *= np.outer(outside, outside)
    dead = np.linalg.norm(jacobian, axis=0) == 0
    unseen[dead, dead] = np.inf
    return part(seen), unseen


def scaled_svd(jacobian: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the columns' lengths, (p,), 1 for a zero one, and singular values and rows of J over them."""
    norms = np.linalg.norm(jacobian, axis=0)
    scale = np.where(norms == 0, 1.0, norms)
    _, singular, rows = np.linalg.svd(jacobian / scale, full_matrices=False)
    return scale, singular, rows


def at_given_bound(plan: Plan, polish: LeastSquaresFit) -> tuple[str, ...]:
    """Return the parameters that lie at a bound which the case gives them."""
    held = []
    for parameter, side in zip(plan.parameters, polish.at_bound.tolist(), strict=False):
        spec = plan.case.parameters.get(parameter.quantity or parameter.name)
        if spec is not None and (spec.minimum if side < 0 else spec.maximum if side > 0 else None) is not None:
            held.append(parameter.name)
    return tuple(held)


def log_likelihood(output: NDArray[np.int64], deviations: FloatArray) -> float:
    """Return −2 log likelihood, up to a constant, of normal noise; `output` is that of each residual."""
    counts = np.bincount(output, minlength=len(deviations))
    return float(np.sum(2 * counts * np.log(deviations)))
