"""Weighted least squares from one start or several: the optimum and its errors. Knows residuals, no motor, no FMU.

    minimise  Σ_j Σ_k (y_jk(θ) − m_jk)² / σ_j²        over x = ln θ (or θ, for parameters not on a log scale)

by the trust-region reflective method (trust_region.py) with a Jacobian of one-sided differences, all of whose
simulations are one batch. σ_j are the residuals' own deviations: found from the fit and put back, until they agree (for
independent normal noise of unknown deviations this is the maximum-likelihood estimate). The covariance at the optimum
is (JᵀJ)⁻¹ with a Jacobian of central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import HUBER, MEDIAN_SIZE
from estimator.fitting import differences
from estimator.fitting.information import information_parts
from estimator.fitting.least_squares_fit import LeastSquaresFit
from estimator.fitting.trust_region import steps, triangle_of
from estimator.plans.parameters import Box

FloatArray = NDArray[np.float64]
Residuals = Callable[[FloatArray], FloatArray]
# Scaled starts, (k, p), weights of the outputs, and what `trust_region.steps` takes -> where each fit ends, as
# `WholeFits.fits` tells.
Whole = Callable[..., Sequence[tuple[FloatArray, float] | None] | None]
# Of a fit: scaled parameters, (p,); its residuals there, (m,), over their deviations, where derivatives are asked, None
# where residuals are.
_Asked = tuple[FloatArray, FloatArray | None]

TOGETHER = 2_000_000  # residuals that are simulated at once for several fits
SOON = 50_000  # residuals of the candidates beside a point: fewer are simulated with it, which a message more outweighs
REWEIGHTINGS = 3
FTOL, XTOL = 1e-14, 1e-11  # of the cost, of a point: times a tolerance, a smaller change ends a fit
TOLERANCE = 1e4  # times rounding's: a step that moves an optimum less than 1e-7 of itself is its last
REWEIGHTED = 0.02  # relative change of the deviations at which reweighting stops
CLOSE, CLOSINGS = 0.02, 3  # of chi-square: an optimum no further above the least is accepted; attempts to come closer
ROUNDING = 1e-12  # of a signal's deviation: rounding of a simulation
NOISE_FREE = 1e-7  # of a signal's deviation: smaller residuals are numerical, not noise
FAILED_RESIDUAL = 1e3  # what a failed simulation shows, in deviations
AT_BOUND = 1e-6  # of the scaled width of the bounds


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
    whole : callable, optional
        Does whole fits of few residuals, or returns None.
    """

    def __init__(
        self,
        residuals: Residuals,
        box: Box,
        *,
        output: NDArray[np.int16],
        spread: FloatArray,
        loss: str = "linear",
        whole: Whole | None = None,
    ) -> None:
        self._robust, self._whole = loss == "huber", whole
        self._residuals, self.box, self._output, self._spread = residuals, box, output, spread

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
        known: LeastSquaresFit | None = None,
    ) -> list[tuple[FloatArray, float]]:
        """Return what `fit` does of every start; what they ask for is simulated together, step by step.

        Parameters
        ----------
        known : LeastSquaresFit, optional
            An optimum at the same deviations: a fit that comes next to it, or whose derivatives lead there, is taken
            to end there, one that comes no nearer to its cost where it stands.
        """
        told = None if central else self._told_whole(starts, deviations, evaluations, tolerance, known)
        if told is not None:
            return told
        many = max(1, TOGETHER // (len(self._output) * self.box.dimension))
        weights = 1 / deviations[self._output]
        found: list[tuple[FloatArray, float]] = []
        for part in (starts[k : k + many] for k in range(0, len(starts), many)):
            asking = [self._fit(start, evaluations, tolerance, known) for start in part]
            asked, beside = {k: next(fit) for k, fit in enumerate(asking)}, dict[int, FloatArray]()
            ends: dict[int, tuple[FloatArray, float]] = {}
            while asked:
                for k, answer in self._answers(asked, beside, weights, central).items():
                    try:
                        asked[k] = asking[k].send(answer)
                    except StopIteration as end:
                        ends[k] = end.value
                        del asked[k]
            found += [ends[k] for k in range(len(part))]
        return found

    def _told_whole(
        self,
        starts: Sequence[FloatArray],
        deviations: FloatArray,
        evaluations: int,
        tolerance: float,
        known: LeastSquaresFit | None,
    ) -> list[tuple[FloatArray, float]] | None:
        """Return the ends of fits that are done in one go; None where they are not."""
        if self._whole is None or self._robust or len(self._output) * self.box.dimension > SOON:
            return None
        own = None if known is None else (self.box.scaled(known.values), known.cost)
        begun = np.array([self._inside(start) for start in starts])
        limits = {"evaluations": evaluations, "ftol": FTOL * tolerance, "xtol": XTOL * tolerance}
        found = self._whole(begun, 1 / deviations, **limits, known=own)
        if found is None:
            return None
        ends = []
        for end in found:
            if end is None:
                assert known is not None
                ends.append((known.values, known.cost))
            else:
                ends.append((self.box.unscaled(end[0]), end[1]))
        return ends

    def _inside(self, start: FloatArray) -> FloatArray:
        """Return a start, (p,), on the parameters' scales, inside the bounds."""
        low, high = self.box.low, self.box.high
        margin = 1e-9 * (high - low)
        return np.asarray(np.clip(self.box.scaled(start), low + margin, high - margin))

    def _answers(
        self, asked: Mapping[int, _Asked], beside: dict[int, FloatArray], weights: FloatArray, central: bool
    ) -> dict[int, FloatArray]:
        """Return what several fits ask for, those first that need no simulation; one batch of simulations tells it.

        Parameters
        ----------
        beside : fit -> raw residuals, (candidates, m), beside its last point, where they have been simulated
        """
        steep = [k for k, (_, at) in asked.items() if at is not None]
        flat = [k for k, (_, at) in asked.items() if at is None]
        soon = len(weights) * self.box.dimension <= SOON
        answers: dict[int, FloatArray] = {}
        if not (soon and steep):
            moved = flat if soon else steep
            points = [self.box.unscaled(np.array([asked[k][0] for k in flat]))] if flat else []
            if moved:
                x = np.array([asked[k][0] for k in moved])
                points.append(differences.beside(self.box, x, central=central).reshape(-1, self.box.dimension))
            raw = self._residuals(np.concatenate(points))
            answers |= zip(flat, self._weighed(raw[: len(flat)], weights), strict=True)
            each = self.box.dimension * (2 if central else 1)
            beside |= zip(moved, raw[len(flat) :].reshape(len(moved), each, len(weights)), strict=True)
        if steep:
            answers |= {k: self._triangle(beside[k], *asked[k], weights, central) for k in steep}
        return answers

    def _triangle(
        self, raw: FloatArray, x: FloatArray, at: FloatArray | None, weights: FloatArray, central: bool
    ) -> FloatArray:
        """Return `triangle_of` a fit's derivatives and residuals, (m,), at x, (p,)."""
        assert at is not None
        jacobian = differences.slopes(raw, self.box, x, weights, at, central=central)
        if self._robust:
            at, slopes = rooted(at)
            jacobian = jacobian * slopes[:, None]
        return triangle_of(jacobian, at)

    def _fit(
        self, start: FloatArray, evaluations: int, tolerance: float, known: LeastSquaresFit | None
    ) -> Generator[_Asked, FloatArray, tuple[FloatArray, float]]:
        """Yield what is asked of scaled parameters; return the optimum, in their units, and its cost."""
        low, high, x = self.box.low, self.box.high, self._inside(start)
        free = high > low
        if not free.any():
            own = yield x, None
            own = rooted(own)[0] if self._robust else own
            return np.array(start), float(own @ own)
        asking = steps(
            x,
            low=low,
            high=np.where(free, high, low + 1e-12),
            evaluations=evaluations,
            ftol=FTOL * tolerance,
            xtol=XTOL * tolerance,
            known=None if known is None else (self.box.scaled(known.values), known.cost),
        )
        last: dict[bytes, FloatArray] = {}
        x, slope = next(asking)
        while True:
            if slope:
                answer = yield x, last[x.tobytes()]
            else:
                at = yield x, None
                last = {x.tobytes(): at}
                answer = rooted(at)[0] if self._robust else at
            try:
                x, slope = asking.send(answer)
            except StopIteration as end:
                if end.value is None:
                    assert known is not None
                    return known.values, known.cost
                found, cost = end.value
                return self.box.unscaled(found), cost

    def deviations(self, values: FloatArray) -> FloatArray:
        """Return the residuals' deviations of each output at a point; the parameters cost degrees of freedom."""
        return self.deviations_of([values])[0]

    def deviations_of(self, points: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the same of several points."""
        many = max(1, TOGETHER // len(self._output))
        parts = [np.array(points[k : k + many]) for k in range(0, len(points), many)]
        return [self._deviations(raw) for part in parts for raw in self._residuals(part)]

    def _deviations(self, raw: FloatArray) -> FloatArray:
        outputs = len(self._spread)
        result = np.empty(outputs)
        for j in range(outputs):
            own = raw[self._output == j]
            own = own[np.isfinite(own)]
            if self._robust and own.any():
                result[j] = float(np.median(np.abs(own[own != 0]))) / MEDIAN_SIZE
                continue
            freedom = max(1.0, len(own) - self.box.dimension / outputs)
            result[j] = np.sqrt(own @ own / freedom) if len(own) else self._spread[j]
        return np.maximum(result, ROUNDING * self._spread)

    def polish(self, start: FloatArray, deviations: FloatArray) -> LeastSquaresFit:
        """Fit, estimate the deviations from the residuals, and repeat until they agree."""
        values, _ = self.fit(start, deviations, tolerance=TOLERANCE)
        for _ in range(REWEIGHTINGS):
            found = self.deviations(values)
            if np.all(found < NOISE_FREE * self._spread):
                deviations = found
                break
            floored = np.maximum(found, NOISE_FREE * self._spread)
            # Only ratios of the deviations move the optimum; a common factor does not.
            ratio = floored / deviations
            deviations = floored
            if np.max(ratio) / np.min(ratio) - 1 <= REWEIGHTED:
                break
            values, _ = self.fit(values, deviations, tolerance=TOLERANCE)
        return self._closed_in(self.judge(values, deviations))

    def _closed_in(self, found: LeastSquaresFit) -> LeastSquaresFit:
        """Continue with central differences if their Jacobian shows that the minimum is not reached.

        One-sided differences distort the gradient along a narrow valley. Encoder counts make such valleys: they
        determine some combination of the parameters a thousand times better than another.
        """
        for _ in range(0 if self._robust else CLOSINGS):
            inside = found.jacobian[:][:, found.at_bound == 0]
            noisy = np.any(found.deviations > NOISE_FREE * self._spread)
            if not noisy or not inside.shape[1] or not np.isfinite(inside).all():
                break
            along = np.linalg.qr(inside)[0].T @ found.residuals
            if float(along @ along) < CLOSE:
                break
            values, cost = self.fit(found.values, found.deviations, evaluations=15, central=True)
            if not cost < found.cost:
                break
            deviations = np.maximum(self.deviations(values), NOISE_FREE * self._spread)
            found = self.judge(values, deviations)
        return found

    def at_bound(self, values: FloatArray) -> NDArray[np.int64]:
        """Return -1, 1 or 0 of each parameter at a point, (p,): at its lower or upper bound, or neither."""
        x, low, high = self.box.scaled(values), self.box.low, self.box.high
        margin = AT_BOUND * np.where(high > low, high - low, 1.0)
        return np.where(x - low <= margin, -1, np.where(high - x <= margin, 1, 0)).astype(np.int64)

    def judge(self, values: FloatArray, deviations: FloatArray) -> LeastSquaresFit:
        """Return covariance and standard errors at a point, for given deviations of the outputs."""
        weights = 1 / deviations[self._output]
        x, at_bound = self.box.scaled(values), self.at_bound(values)
        beside = differences.beside(self.box, x, central=True).reshape(-1, self.box.dimension)
        raw = self._residuals(np.concatenate([self.box.unscaled(x)[None, :], beside]))
        residuals, raw = self._weighed(raw[:1], weights)[0], raw[1:]
        jacobian = differences.slopes(raw, self.box, x, weights, residuals, central=True)
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
            at_bound=at_bound,
            jacobian=jacobian,
            residuals=residuals,
            scores=wider * jacobian.T @ jacobian,
        )

    def _weighed(self, raw: FloatArray, weights: FloatArray) -> FloatArray:
        """Return residuals, (c, m), over their deviations; large ones where the simulation failed."""
        weighted = raw * weights
        sound = np.isfinite(weighted)
        if not sound.all():
            weighted[~sound.all(axis=1)] = FAILED_RESIDUAL
        return np.asarray(weighted)


def rooted(residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals, (m,), whose squares are twice Huber's loss, and their derivatives by the plain ones."""
    size = np.abs(residuals)
    far = size > HUBER
    root = np.sqrt(np.where(far, 2 * HUBER * size - HUBER**2, 1.0))
    return np.where(far, np.sign(residuals) * root, residuals), np.where(far, HUBER / root, 1.0)
