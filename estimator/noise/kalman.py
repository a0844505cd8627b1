"""Coloured noise made white, exactly: a Kalman filter over residuals and Jacobian. Knows no motor and no FMU.

The noise of q channels is H x + white noise, x a linear Gaussian state of d numbers. With Σ the covariance of all
samples that are there, whitening is the lower-triangular W with WᵀW = Σ⁻¹: least squares of whitened residuals is
generalised least squares, and −2 log L = |W r|² + log det Σ + N log 2π. ``kalman.c`` does it in a time proportional to
the rows.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimator.errors import InputError
from estimator.plans.part import LONG
from estimator.stepping.library import KALMAN, check_installed

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WHOLE, REAL, PLACE = ctypes.c_int64, ctypes.c_double, ctypes.c_void_p
FUNCTIONS: Mapping[str, tuple[Any, Sequence[Any]]] = {  # of kalman.c → what each returns, what it takes
    "kalman_gains": (WHOLE, [WHOLE] * 4 + [PLACE] * 9),
    "kalman_apply": (WHOLE, [WHOLE] * 5 + [PLACE] * 8),
    "kalman_shorten": (None, [WHOLE] * 4 + [PLACE] * 6),
    "recursion_run": (None, [WHOLE] * 4 + [PLACE] * 4),
    "sections_run": (None, [*[WHOLE] * 3, PLACE, PLACE, WHOLE, WHOLE, PLACE, WHOLE]),
    "response_run": (None, [*[WHOLE] * 3, REAL, *[PLACE] * 9]),
    "gram_factor": (WHOLE, [WHOLE, REAL, PLACE, PLACE]),
    "fit_bytes": (WHOLE, [WHOLE]),
    "fit_begin": (WHOLE, [PLACE, WHOLE, WHOLE, REAL, REAL, PLACE, PLACE, PLACE, REAL, PLACE]),
    "fit_take_cost": (WHOLE, [PLACE, REAL, WHOLE, PLACE]),
    "fit_take_slopes": (WHOLE, [PLACE, PLACE, WHOLE, PLACE]),
    "descent_bytes": (WHOLE, [WHOLE]),
    "descent_begin": (WHOLE, [PLACE, *[WHOLE] * 5, *[REAL] * 4, *[PLACE] * 5, REAL, REAL, WHOLE, PLACE]),
    "descent_take_triangle": (WHOLE, [PLACE, PLACE, PLACE, WHOLE, PLACE]),
    "descent_take_cost": (WHOLE, [PLACE, REAL, PLACE]),
    "scaled_column": (None, [WHOLE, PLACE, PLACE, WHOLE, PLACE, PLACE]),
    "scaled_gram": (None, [WHOLE, PLACE, WHOLE, *[PLACE] * 4]),
    "scaled_products": (None, [WHOLE, PLACE, PLACE, WHOLE, PLACE, PLACE, WHOLE, *[PLACE] * 3]),
    "memory_give_back": (None, []),
    "memory_keep": (None, [ctypes.c_int] * 2),
}
STRETCH = 2  # samples without a gap: of shorter ones no colour is told within them
LEAST_KEPT = 1e-12  # of a variance that one more row behind a sample leaves
LARGEST_KEPT, MOST_KEPT = 32 << 20, 256 << 20  # bytes: of an array, as many as glibc allows; of all of them


@dataclass(frozen=True)
class Gains:
    """Gains of a Kalman filter over some rows, which whiten any columns: they depend on the noise alone.

    Attributes
    ----------
    transition : (k, d, d) array
    readout : (q, d) array
    steps : (rows,) array of int, or None
    gain : (rows, q, d) array
        What a channel's innovation changes of the state.
    scale : (rows, q) array
        One over the innovations' standard deviations; 0 where a sample is missing.
    log_determinant : float
        Sum of the logarithms of the innovations' variances.
    """

    transition: FloatArray
    readout: FloatArray
    steps: IntArray | None
    gain: FloatArray
    scale: FloatArray
    log_determinant: float

    def whiten(self, columns: FloatArray, size: FloatArray | None = None) -> FloatArray:
        """Return columns, (rows, q, c), whitened: innovations over their deviations, 0 where a sample is missing.

        Parameters
        ----------
        columns : (rows, q, c) array
            Residuals and Jacobian columns of q channels; anything where a sample is missing.
        size : (rows, q) array, optional
            Each sample is divided by it first.

        Raises
        ------
        ValueError
            The shapes do not fit.
        """
        columns = np.ascontiguousarray(columns, dtype=np.float64)
        size = None if size is None else np.ascontiguousarray(size, dtype=np.float64)
        n, q, d = self.gain.shape
        if columns.ndim != 3 or columns.shape[:2] != (n, q) or (size is not None and size.shape != (n, q)):
            raise ValueError(f"columns {columns.shape} must be ({n}, {q}, c), and sizes one of each sample")
        whitened = np.empty_like(columns)
        arrays = (self.transition, self.readout, self.steps, self.gain, self.scale, size, columns, whitened)
        _called("kalman_apply", n, q, columns.shape[2], d, len(self.transition), *_pointers(arrays))
        return whitened


def gains(
    variance: FloatArray,
    *,
    transition: FloatArray,
    process: FloatArray,
    initial: FloatArray,
    readout: FloatArray,
    steps: IntArray | None = None,
) -> Gains:
    """Return the gains of a noise.

    Parameters
    ----------
    variance : (rows, q) array
        White measurement variance of each sample, above 0; infinite where it is missing.
    transition, process : (k, d, d) arrays
        Transition of the state and the covariance added, for k distinct time steps. d may be 0.
    initial : (d, d) array
        Covariance of the state in the first row, its mean 0.
    readout : (q, d) array
        What each channel shows of the state.
    steps : (rows,) array of int, optional
        Which of the k time steps leads from the row before to each row (row 0: not used); by default always the first.

    Raises
    ------
    ValueError
        The shapes do not fit, a variance is not above 0, or a time step's index is not one of the k.
    InputError
        The compiled filter is missing.
    """
    given = (variance, transition, process, initial, readout)
    variance, transition, process, initial, readout = [np.ascontiguousarray(a, dtype=np.float64) for a in given]
    if variance.ndim != 2 or transition.ndim != 3:
        raise ValueError(f"variance {variance.shape} must be (rows, q) and transition {transition.shape} (k, d, d)")
    (n, q), (k, d, _) = variance.shape, transition.shape
    shapes = (transition.shape, process.shape, initial.shape, readout.shape)
    if shapes != (right := ((k, d, d), (k, d, d), (d, d), (q, d))) or k == 0:
        raise ValueError(f"transition, process, initial, readout are of shapes {shapes}; expected {right}")
    if not variance.min(initial=1.0) > 0:
        raise ValueError("a measurement variance is not above 0")
    if steps is not None:
        steps = np.ascontiguousarray(steps, dtype=np.int64)
        if steps.shape != (n,) or (n > 1 and not 0 <= int(steps[1:].min()) <= int(steps[1:].max()) < k):
            raise ValueError(f"steps must be {n} indices from 0 to {k - 1}")
    gain, scale = np.empty((n, q, d)), np.empty((n, q))
    logarithms = ctypes.c_double(0.0)
    arrays = (transition, process, initial, readout, steps, variance, gain, scale)
    _called("kalman_gains", n, q, d, k, *_pointers(arrays), ctypes.byref(logarithms))
    return Gains(transition, readout, steps, gain, scale, logarithms.value)


def _pointers(arrays: Sequence[NDArray[Any] | None]) -> list[int | None]:
    return [None if array is None else array.ctypes.data for array in arrays]


def _called(function: str, *arguments: Any) -> None:
    if getattr(filters(), function)(*arguments) != 0:
        raise MemoryError("no memory for the Kalman filter")


def shorten(
    whitened: FloatArray,
    present: NDArray[np.bool_],
    second: NDArray[np.bool_],
    models: Sequence[Sequence[tuple[FloatArray, float]]],
    behind: IntArray,
) -> float:
    """Take the short autoregressions of two states of the machine out of whitened columns, in place.

    Returns the sum of the logarithms of the variances that are left of samples of variance 1.

    Parameters
    ----------
    whitened : (rows, q, c) array, contiguous
    present : (rows, q) array
        Samples that are there; the others become 0.
    second : (rows,) array
        Rows of which the second model holds, not the first.
    models : two, of each channel: coefficients, and the innovation's deviation
    behind : (rows, q) array
        As `rows_behind`, of all rows of the recording; of those before these columns are zero.
    """
    if all(not len(a) and deviation == 1.0 for model in models for a, deviation in model):
        return 0.0  # nothing is left to take out
    n, q, c = whitened.shape
    order = np.array([[len(a) for a, _ in model] for model in models], dtype=np.int64)
    most = max(1, int(order.max()))
    coefficients, deviation = np.zeros((2, q, most + 1, most)), np.ones((2, q, most + 1))
    for k, model in enumerate(models):
        for j, (a, s) in enumerate(model):
            own, parts = predictors(a.tobytes())
            coefficients[k, j, : len(own), : len(a)] = own
            deviation[k, j, : len(own)] = s * parts
    kind, there = np.ascontiguousarray(second, dtype=np.uint8), np.ascontiguousarray(present, dtype=np.uint8)
    behind = np.minimum(behind, order[kind])
    arrays = (coefficients, deviation, kind, behind.astype(np.uint8), there, whitened)
    filters().kalman_shorten(n, q, c, most, *(a.ctypes.data for a in arrays))
    left = deviation[kind[:, None], np.arange(q), behind]
    return float(2 * np.sum(np.log(left), where=present))


@lru_cache(maxsize=256)
def predictors(coefficients: bytes) -> tuple[FloatArray, FloatArray]:
    """Return what predicts by the last 0 to p rows, (p + 1, p), and by how many times more than by p it errs, (p + 1,).

    Of an autoregression of p coefficients, by Levinson's recursion backwards.
    """
    a = np.frombuffer(coefficients)
    p = len(a)
    each, errors = np.zeros((p + 1, p)), np.ones(p + 1)
    for m in range(p, 0, -1):
        each[m, :m], last = a, float(a[-1])
        kept = max(1 - last * last, LEAST_KEPT)
        a, errors[m - 1] = (a[:-1] + last * a[-2::-1]) / kept, errors[m] / np.sqrt(kept)
    return each, errors


def rows_behind(present: NDArray[np.bool_], outlying: NDArray[np.bool_], most: int) -> IntArray:
    """Return how many rows a sample has behind it, (n,), `most` at most: since its recording began, or a gap.

    An outlier is as good as a gap. Where every other sample or more is missing a gap is what the colour was told with,
    too: zeros, then.
    """
    rows, at = np.zeros(len(present), dtype=np.int64), np.flatnonzero(present)
    apart = np.diff(at, prepend=-most - 1)
    stretches = int(np.count_nonzero(apart > 1))
    begins = apart > (1 if len(at) > STRETCH * stretches else most)
    if outlying.any():
        begins |= outlying[at] | np.concatenate([[False], outlying[at[:-1]]])
    rows[at] = np.minimum(at - np.maximum.accumulate(np.where(begins, at, 0)), most)
    return rows


@cache
def filters() -> ctypes.CDLL:
    """Return the compiled filters; what arrays have left is kept for the next ones from then on.

    An estimation makes thousands of arrays of 0.1 to 30 MB. glibc gives each back to the system at once and asks for it
    anew, page by page: a tenth of a short estimate, a fifth of a long one.
    """
    check_installed(KALMAN)
    library = ctypes.CDLL(str(KALMAN))
    if not all(hasattr(library, name) for name in FUNCTIONS):
        raise InputError(f"{KALMAN} is of an older version: install fmu-estimator again by pip, which compiles it")
    for name, (result, arguments) in FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    library.memory_keep(LARGEST_KEPT, MOST_KEPT)
    return library


def give_back(rows: int) -> None:
    """Give back to the system what arrays of many rows have left: before the largest of them are made."""
    if rows > LONG:
        filters().memory_give_back()
