"""Derivatives of what sensors show by what is free, by differences, simulated when asked. Knows no noise and no fit.

Most fits are only compared by their cost: nobody asks for the derivatives where they end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.differences import DIFFERENCE_STEP
from estimator.fitting.simulator import CELLS, Simulator
from estimator.noise.in_parts import blocks

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Point:
    """What is free of a simulator's values, at one point.

    Attributes
    ----------
    where : (f,) array of int
        Places of what is free among the simulator's names.
    values : (p,) array
        Of all names; what is free at `x`.
    x, low, high : (f,) array
        What is free, and its bounds, on its scale.
    shown : (rows, q) array
        What the sensors show there.
    between : int
        As the simulator's, when it showed that.
    """

    simulator: Simulator
    where: NDArray[np.int_]
    values: FloatArray
    x: FloatArray
    low: FloatArray
    high: FloatArray
    shown: FloatArray
    between: int

    def beside(self, x: FloatArray) -> FloatArray:
        """Return candidates, (f, p), each with one of what is free at its x, (f,)."""
        points = np.repeat(self.values[None, :], len(x), axis=0)
        points[np.arange(len(x)), self.where] = self.simulator.unscaled(x, self.where)
        return points

    def slopes(self, *, central: bool) -> FloatArray:
        """Return derivatives of what is shown by what is free, (rows, q, f), by one-sided or central differences.

        Central ones are remembered for as long as no others are asked for: they are not to be changed.
        """
        s, x, f = self.simulator, self.x, len(self.where)
        h = difference_steps(s, self.where, s.spacing(self.values)[self.where] / (2 if central else 1))
        ahead = np.where(x + h <= self.high, x + h, x - h)
        behind = np.where((x - h >= self.low) & (ahead > x), x - h, x) if central else x
        points = np.array([self.beside(end) for end in ((ahead, behind) if central else (ahead,))])
        key = points.tobytes(), s.between
        if central and s.derivatives is not None and s.derivatives[0] == key:
            return s.derivatives[1]
        if central:
            s.derivatives = None
        result = np.zeros((f, *self.shown.shape))  # column by column, as they are simulated
        many = max(1, CELLS // (s.rows * len(points)))  # of what is free, at once: of a long recording one by one
        room = max(1, CELLS // s.rows)
        for part in (np.arange(f)[k : k + many] for k in range(0, f, many)):
            asked = np.concatenate(points[:, part])
            ends = [end for one in (asked[k : k + room] for k in range(0, len(asked), room)) for end in s.shown(one)]
            sound = [bool(np.isfinite(end).all()) for end in ends]
            for j, k in enumerate(part):
                back, width = self.shown, ahead[k] - x[k]
                if central and sound[len(part) + j]:
                    back, width = ends[len(part) + j], ahead[k] - behind[k]
                for at in blocks(len(back)) if sound[j] else ():  # which stay in a processor's cache
                    np.subtract(ends[j][at], back[at], out=result[k, at])
                    result[k, at] /= width
            del ends  # before the next are simulated
        found = np.moveaxis(result, 0, 2)
        if central:
            s.derivatives = key, found
        return found


def difference_steps(s: Simulator, where: NDArray[np.int_], least: FloatArray) -> FloatArray:
    """Return the steps of differences, (f,), of some of a simulator's names, on their scales; no less than `least`."""
    return np.maximum(np.where(s.log[where], DIFFERENCE_STEP, 10 * DIFFERENCE_STEP * s.size[where]), least)


class Slopes:
    """The derivatives of one point, (rows, q, f), when asked.

    Parameters
    ----------
    point : Point or None
        None: they are given, and no differences.
    central : bool
        By central differences.
    known : (rows, q, f) array, optional
        The derivatives, where they are known already.
    """

    def __init__(self, point: Point | None, *, central: bool = True, known: FloatArray | None = None) -> None:
        self._point, self._central = point, central
        if known is not None:
            self.__dict__["raw"] = known

    @cached_property
    def raw(self) -> FloatArray:
        """The derivatives, (rows, q, f)."""
        assert self._point is not None
        return self._point.slopes(central=self._central)

    def begun(self, simulator: Simulator, where: NDArray[np.int_], values: FloatArray) -> Point | None:
        """Return the point, if a simulator showed it at these values with the same free: it need not do so again."""
        here = self._point
        if here is None or here.simulator is not simulator or here.between != simulator.between:
            return None
        return here if np.array_equal(here.where, where) and np.array_equal(here.values, values) else None

    def of(self, shown: FloatArray) -> Slopes:
        """Return those of the same point, of which what is shown, (rows, q), is held elsewhere; none is known."""
        point = self._point and replace(self._point, shown=shown)
        return Slopes(point, central=self._central, known=self.raw if point is None else None)

    def known(self, *, central: bool) -> FloatArray | None:
        """Return the derivatives, if they are known, and central where these are asked for; not to be changed."""
        return self.__dict__.get("raw") if self._central or not central else None

    def forget(self) -> None:
        """Give up the memory of derivatives that can be simulated again."""
        if self._point is not None:
            self.__dict__.pop("raw", None)
