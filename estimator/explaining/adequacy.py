"""Whether an explanation is adequate: tests of its whitened residuals, window by window. Knows no effect.

In every window (windows.py) the whitened residuals z are tested in three ways. Where the explanation holds they are
independent, with variance 1:

    size        mean of z^2, Fisher's F with the window's samples and those that tell the noise (its variance by the
                tails that settled rows show)
    neighbours  sum of z_k z_k+1, over the root of their number, standard normal (not of errors that repeat themselves,
                nor of a sensor whose steps are larger than its noise)
    own values  score test of parameters of the window's own, by its rows of the Jacobian (Hausman 1978)

Besides, whether the sensors answer to changes as it is explained (response_test.py), and friction to the speed
(friction_test.py). An explanation that holds fails any of the first tests with the chance FALSE_ALARM, which they share
equally (Bonferroni), and each of the last two likewise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.conventions import FALSE_ALARM, RESOLVED, SMALL_CORRELATION
from estimator.distributions import chi_square_limit, f_limit, normal_quantile
from estimator.explaining.coarse_levels import held_by_sensor
from estimator.explaining.friction_test import unexplained_friction
from estimator.explaining.response_test import unexplained_responses
from estimator.fitting.fit import Fit
from estimator.fitting.score_test import ScoreTest
from estimator.fitting.windows import Windows, find_windows
from estimator.noise.in_parts import AT_ONCE, Columns
from estimator.plans.part import LONG

FloatArray = NDArray[np.float64]

RANK_TOLERANCE = 1e-12  # of the correlations' eigenvalues: a direction with a smaller one is fixed
WINDOW_RANK_TOLERANCE = 1e-3  # of the largest singular value: directions that a window tells
COARSE = 0.42  # of a sensor's step: white noise that is no more is of the step, but for 0.3 steps
EXCESS = 0.15  # of a variance, or a limit: a smaller excess widens the standard errors, and is no failure
# Times the noise found: residuals that are larger in a window, and noise in all other ways, are no reason to doubt. How
# noise grows with the signals is extrapolated there from other samples; other tests ask whether estimates are moved.
LOUDER = 2.0
TELLS = 1e-3  # of all samples' information: a part that tells less moves no estimate by a fifth of its bar, at six bars
REST_TELLS = 0.05  # of all samples' information: with less, those outside a window do not determine a direction
WHOLE = "the recording"  # the window of an output that is tested against the others


@dataclass(frozen=True)
class Failure:
    """A test that failed: which, in which window and output, and by which factor its statistic is too large."""

    what: str
    window: str
    output: str
    excess: float

    @property
    def is_doubt(self) -> bool:
        """Whether the estimate is doubtful for it alone, however much wider it makes the standard errors."""
        return self.what != "size" or self.excess > LOUDER

    @property
    def sentence(self) -> str:
        """Return the failure in words."""
        if self.what == "friction":
            return (
                "friction depends on the speed otherwise than it is explained: a load, such as a fan, or a dry friction"
                " is missing; record several speeds"
            )
        if self.what == "response":
            answers = f"{self.output} answers" if self.output else f"{self.window} answer"
            return (
                f"{answers} to changes, in the samples that follow, otherwise than it is explained: a filter, a delay"
                " or a limit of the drive is missing; sample faster, or declare it"
            )
        alone = f"{self.output} alone" if self.window == WHOLE else f"{self.output} in {self.window}"
        where = alone if self.output else self.window
        if self.what == "size":
            many = f"{self.excess:.1f} times the noise found"
            return f"the model does not explain {where}: the residuals, whitened, are {many}"
        if self.what == "neighbours":
            alike = "alike" if self.excess > 0 else "opposite"
            return (
                f"the residuals of {where} are no plain noise: neighbours are {alike} (correlation {self.excess:+.2f})"
            )
        return (
            f"{where} would fit other parameters than the rest of the recording does, {self.excess:.3g} times as far"
            " away as noise alone leads"
        )


@dataclass(frozen=True)
class Adequacy:
    """The tests that failed, and by how much the standard errors grow for them, and for what nearly failed.

    Attributes
    ----------
    excess : (rows, q) array
        Factor on the variance of each sample.
    parts : (rows, q) arrays
        Samples that failed together: they may bias the parameters by a common error.
    shift : (f + m,) array
        By how much another law of friction would move what is free, on its scales.
    """

    failures: tuple[Failure, ...]
    excess: FloatArray
    parts: tuple[NDArray[np.bool_], ...]
    shift: FloatArray
    tests: int

    @property
    def doubts(self) -> tuple[Failure, ...]:
        """The failures for which the estimate is doubtful: all, or none."""
        return self.failures if any(f.is_doubt for f in self.failures) else ()

    def widened(self, fit: Fit) -> FloatArray:
        """Return the covariance that the failures add to that of a fit's names, (f + m, f + m).

        Samples that fail add errors of their own (White 1980) and one common to their part (Liang and Zeger 1986).
        """
        inside = fit.at_bound == 0
        result = np.zeros((len(inside), len(inside)))
        nearly = bool(self.parts) or np.max(self.excess) > 1
        if inside.any() and (self.failures or (nearly and fit.simulator.rows <= LONG)):  # else it holds all columns
            jacobian, covariance = fit.jacobian[:, inside], fit.covariance_parts()[0][np.ix_(inside, inside)]
            more = (self.excess.ravel() - 1)[:, None]
            scores = jacobian.T @ (more * jacobian)
            grown = covariance @ scores @ covariance
            for part in self.parts:
                shift = _shift_without(jacobian, fit.z, part.ravel())
                grown += np.outer(shift, shift)
            result[np.ix_(inside, inside)] = grown
        return result + np.outer(self.shift, self.shift)


def _shift_without(jacobian: FloatArray, z: FloatArray, part: NDArray[np.bool_]) -> FloatArray:
    """Return by how much the estimates move, (f,), when the samples of a part are left out.

    Directions that the other samples hardly determine stay as they are.
    """
    whole = jacobian.T @ jacobian
    norms = np.sqrt(np.diag(whole))
    scale = np.where(norms > 0, 1 / np.where(norms > 0, norms, 1.0), 0.0)
    own = jacobian[part] * scale
    rest = (whole * scale).T * scale - own.T @ own
    told, axes = np.linalg.eigh(rest)
    pull = axes.T @ (own.T @ z[part])
    total = np.einsum("ji,jk,ki->i", axes, (whole * scale).T * scale, axes)
    seen = total > WINDOW_RANK_TOLERANCE**2
    gain = np.where(
        told > REST_TELLS * total,
        1 / np.maximum(told, WINDOW_RANK_TOLERANCE**2),
        np.where(seen, 1 / np.maximum(total, WINDOW_RANK_TOLERANCE**2), 0.0),
    )
    return np.asarray(-scale * (axes @ (gain * pull)))


def adequacy(fit: Fit, parameters: int, *, is_searched: bool = True) -> Adequacy:
    """Test an explanation and return what fails.

    Parameters
    ----------
    parameters : int
        How many of the fit's names, the first ones, are the motor's.
    is_searched : bool
        Effects have been looked for: only then is it asked whether a further response is missing.
    """
    windows = find_windows(fit)
    z = fit.z.reshape(fit.shown.shape)
    present = fit.whitener.present & (fit.whitener.inflate == 1.0)
    tails = _tails(z, present, windows)
    known_by = np.array([max(np.count_nonzero(windows.settled & own), 2) for own in present.T])  # that tell the noise
    outputs = fit.simulator.outputs
    count = 2 * len(windows.windows) * len(outputs) + len(windows.windows) + len(outputs)
    normal = normal_quantile(1 - FALSE_ALARM / count)
    failures, excess, parts = [], np.broadcast_to(1.0, z.shape), []
    resolved = np.abs(np.nan_to_num(fit.residuals())) > RESOLVED * fit.simulator.steps
    repeats = fit.whitener.noise.repeats or (False,) * len(outputs)
    alike_anyway = np.array(repeats) | held_by_sensor(fit) | (fit.whitener.noise.white < COARSE * fit.simulator.steps)
    for window in windows.windows:
        for j, output in enumerate(outputs):
            known = present[window.rows, j]
            own = z[window.rows, j]
            n = int(known.sum())
            if n < 2:
                continue
            square = float(np.sum(own[known] ** 2)) / n
            limit = f_limit(n, float(known_by[j]), FALSE_ALARM / count)
            limit = max(limit, 1 + normal * np.sqrt(2 * tails[j] * (1 / n + 1 / known_by[j])))
            seen = not fit.simulator.steps[j] or bool(np.any(resolved[window.rows, j]))
            if seen and square > limit:
                excess = _raised(excess, (window.rows, j), square)
            if seen and square > max(limit, 1 + EXCESS):
                failures.append(Failure("size", window.name, output, float(np.sqrt(square))))
                parts.append(_samples(z, window.rows, j))
            pairs = known[1:] & known[:-1] & (np.diff(window.rows) == 1)
            m = int(pairs.sum())
            if m >= 8 and not alike_anyway[j]:
                alike = float(np.sum((own[1:] * own[:-1])[pairs])) / m
                if abs(alike) > max(normal / np.sqrt(m) * square, SMALL_CORRELATION):
                    correlation = float(np.clip(alike / max(square, 1e-300), -1, 1))
                    failures.append(Failure("neighbours", window.name, output, correlation))
                    parts.append(_samples(z, window.rows, j))
                    longer = (1 + abs(alike)) / (1 - min(abs(alike), 0.9))
                    excess = _raised(excess, (window.rows, j), longer)
    test, axes = fit.test(), _axes(fit, parameters)
    for name, output, mask in _groups(windows, outputs, z.shape):
        ratio = _own_values(fit.whitened, test, mask.ravel(), axes, FALSE_ALARM / count)
        if ratio > 1:
            excess = _raised(excess, mask, ratio**2)
            parts.append(mask)
        if ratio**2 > 1 + EXCESS:
            failures.append(Failure("own values", name, output, ratio))
    white = np.logical_not(repeats) | (fit.whitener.noise.differenced > 0)  # as far as is known
    noisy = [j for j in range(len(outputs)) if white[j] and (not fit.simulator.steps[j] or np.any(resolved[:, j]))]
    for output, ratio in unexplained_responses(fit, FALSE_ALARM, noisy if is_searched else ()):
        if ratio**2 > 1 + EXCESS:
            failures.append(Failure("response", " and ".join(outputs), output, ratio))
        mask = windows.onsets[:, None] & np.array([output in ("", y) for y in outputs])
        excess = _raised(excess, mask, ratio**2)
        parts.append(mask)
    shift = np.zeros(len(fit.names))
    if is_searched:
        ratio, moved = unexplained_friction(fit, FALSE_ALARM)
        if ratio**2 > 1 + EXCESS:
            failures.append(Failure("friction", "", "", ratio))
            shift = moved
    different = {part.tobytes(): part for part in parts}
    return Adequacy(tuple(failures), excess, tuple(different.values()), shift, count)


def _raised(excess: FloatArray, where: Any, least: float) -> FloatArray:
    """Return an excess, (rows, q), that is no less in some samples; changed in its place where it is written to."""
    excess = excess if excess.flags.writeable else excess.copy()
    excess[where] = np.maximum(excess[where], least)
    return excess


def _samples(z: FloatArray, rows: NDArray[np.int32], j: int) -> NDArray[np.bool_]:
    mask = np.zeros(z.shape, dtype=bool)
    mask[rows, j] = True
    return mask


def _groups(
    windows: Windows, outputs: Sequence[str], shape: tuple[int, ...]
) -> list[tuple[str, str, NDArray[np.bool_]]]:
    """Return the parts, (rows, q), that are tested for parameters of their own, each with its window and output."""
    groups = []
    for w in windows.windows:
        if len(w.rows) < shape[0]:
            mask = np.zeros(shape, dtype=bool)
            mask[w.rows] = True
            groups.append((w.name, "", mask))
    for j, y in enumerate(outputs if len(outputs) > 1 else ()):
        mask = np.zeros(shape, dtype=bool)
        mask[:, j] = True
        groups.append((WHOLE, y, mask))
    return groups


def _axes(fit: Fit, parameters: int) -> FloatArray:
    """Return directions of the parameters, (p, k), by which each has an information of 1 and is told by itself."""
    covariance = fit.covariance_parts()[0][:parameters, :parameters]
    deviations = np.sqrt(np.diag(covariance))
    scale = np.where(deviations > 0, 1 / np.where(deviations > 0, deviations, 1.0), 0.0)
    sizes, axes = np.linalg.eigh(covariance * np.outer(scale, scale))
    known = sizes > RANK_TOLERANCE
    return np.asarray(deviations[:, None] * axes[:, known] * np.sqrt(sizes[known]))


def _own_values(jacobian: Columns, test: ScoreTest, mask: NDArray[np.bool_], axes: FloatArray, chance: float) -> float:
    """Return how much larger the score of own parameters in a part is than its quantile; its root.

    In those directions, of `axes`, of which the part tells something.
    """
    parameters = len(axes)
    spanned, left, alike = test.known.spanned, test.left, test.known.spanned is jacobian
    information, products = np.zeros((parameters, parameters)), np.zeros((spanned.shape[1], parameters))
    along = np.zeros(parameters)
    first, end = int(mask.argmax()), len(mask) - int(mask[::-1].argmax())
    for at in (slice(k, min(k + AT_ONCE, end)) for k in range(first, end, AT_ONCE)):  # copies no whole column
        inside = mask[at]
        own = _picked(jacobian[at], inside)
        others = own if alike else _picked(spanned[at], inside)
        own = own[:, :parameters]
        information += own.T @ own
        products += others.T @ own
        along += own.T @ left[at][inside]
    known = test.known.of_products(products) @ axes
    power, turned = np.linalg.eigh(axes.T @ information @ axes - known.T @ known)
    told = power > TELLS
    if not told.any():
        return 0.0
    along = turned[:, told].T @ (axes.T @ along)
    return float(np.sqrt(np.sum(along**2 / power[told]) / chi_square_limit(int(told.sum()), chance)))


def _picked(columns: FloatArray, inside: NDArray[np.bool_]) -> FloatArray:
    """Return some rows, of all no copy; some ten times as quick as by an index."""
    return columns if inside.all() else columns.compress(inside, axis=0)


def _tails(z: FloatArray, present: NDArray[np.bool_], windows: Windows) -> FloatArray:
    """Return, of each channel, var z^2 / 2 in settled rows: 1 for a normal distribution, at least 1."""
    result = np.ones(z.shape[1])
    for j in range(z.shape[1]):
        own = z[windows.settled & present[:, j], j]
        if len(own) > 50:
            result[j] = float(np.clip(np.var(own**2) / 2 / max(np.mean(own**2) ** 2, 1e-300), 1.0, 5.0))
    return result
