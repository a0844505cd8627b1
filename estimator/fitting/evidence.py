"""How sure a direction in the residuals is, by the colour of the noise where all has settled. Knows no FMU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.noise import Differenced, Spectrum, find_colour, quadratic
from estimator.fitting.polish import Polish
from estimator.fitting.problem import Problem
from estimator.fitting.treatment import Treatment
from estimator.plans.plan import ChainSpec
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

SETTLED_FROM = 0.2  # of the part after the step: what follows tells the noise


class Evidence:
    """Judge of directions beside a fit's parameters.

    Parameters
    ----------
    residuals : (m,) array
        Weighted, after the treatment.
    start : int
        Sample at which the input acts first, in the only recording.
    explained : float
        Of a direction's power: where less is left by the parameters, it cannot be told from them.
    """

    def __init__(
        self,
        problem: Problem,
        polish: Polish,
        treatment: Treatment,
        residuals: FloatArray,
        *,
        start: int,
        explained: float = 1e-9,
    ) -> None:
        self._explained = explained
        self._problem, self._treatment, self._residuals = problem, treatment, residuals
        inside = polish.jacobian[:, polish.at_bound == 0]
        if inside.shape[1]:
            inside = treatment.apply(inside.T, weighted=True).T
        self._basis = np.linalg.qr(inside)[0] if inside.shape[1] else inside
        self._weights = 1 / polish.deviations[problem.output_of_residual]
        self._spectra = [self._colours(j, start) for j in range(len(problem.outputs))]

    def _colours(self, j: int, start: int) -> list[Spectrum]:
        """Return what the noise of an output may be: as it is when settled, and as its sensor makes it."""
        problem, plan = self._problem, self._problem.plan
        series = problem.series(np.where(self._treatment.keep > 0, self._residuals, np.nan), j)[0][0]
        late = series[start + int(SETTLED_FROM * (len(series) - start)) :]
        found: list[Spectrum] = [find_colour([_straightened(late)])]
        y = problem.outputs[j]
        variance = float(np.nanmean(series * series))
        if plan.sensors[y] == layout.MEAN and not plan.counted:
            sections = plan.chains.get(y, ChainSpec()).sections(plan.observed[0].recording.step)
            found.append(Differenced(variance, sections))
        elif y == "angle" or plan.counted:
            found.append(find_colour([np.full(1, np.sqrt(variance))]))
        return found

    def __call__(self, column: FloatArray) -> tuple[float, float]:
        """Return standard deviations and size of an (m,) direction in the outputs' units."""
        weighted = self._treatment.apply((column * self._weights)[None, :], weighted=True)[0]
        across = weighted - self._basis @ (self._basis.T @ weighted)
        power = float(across @ across)
        if power <= self._explained * float(weighted @ weighted):
            return 0.0, 0.0
        variance = 0.0
        for j, spectra in enumerate(self._spectra):
            columns = self._problem.spread_columns(across[:, None], j)
            variance += max(float(quadratic(columns, s)[0, 0]) for s in spectra)
        product = float(across @ self._residuals)
        return abs(product) / max(np.sqrt(variance), 1e-300), -product / power


def _straightened(series: FloatArray) -> FloatArray:
    """Return a series, NaN where missing, less its straight line: a drift is no colour of the noise."""
    known = ~np.isnan(series)
    if known.sum() < 3:
        return series
    k = np.arange(len(series), dtype=float)
    slope, level = np.polyfit(k[known], series[known], 1)
    return np.asarray(series - slope * k - level)
