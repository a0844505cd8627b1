"""An addition to an explanation: what it holds, what its score test says, what it costs. Knows no search.

Its penalty is k log n + 2 log (1 / prior) for k numbers, n the samples: Schwarz's criterion with the prior of the
effect, which columns that exclude each other share.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from estimator.explaining.effects.base import Effect
from estimator.fitting.fit import Fit, Linear
from estimator.fitting.score_test import ScoreTest
from estimator.fitting.simulator import Simulator
from estimator.noise.in_parts import Columns, products, square

FloatArray = NDArray[np.float64]

NEVER_ZERO = ("R", "K", "J")  # at a bound something else stands for it; L and B may vanish
AGAIN = 0.5  # prior of what another recording has, or another thing in this one foretells
MOST = 0.5  # of z'z that is left, at most, where most is explained
OPEN = 4.0  # penalty of each number whose usual size is not known, where it is averaged over
NOTHING = 1e-9  # of the power of a change: the recordings do not show it


@dataclass(frozen=True)
class Scores:
    """What a score test says of k columns, for a unit of each: all that is needed of them beside a fit.

    Attributes
    ----------
    along : (k,) array
        A'r, A the whitened columns without their part that the fit explains, r what it leaves.
    information : (k, k) array
        A'A.
    whole : float
        Sum of squares of the whitened columns, W.
    explained : (f + m, k) array
        J'W, J the fit's derivatives.
    moves : (f + m, k) array
        By how much the fit moves, on its names' scales, if they are there and left out.
    """

    along: FloatArray
    information: FloatArray
    whole: float
    explained: FloatArray
    moves: FloatArray

    @property
    def gain(self) -> float:
        """The fall of z'z by a single column."""
        power, along = float(self.information[0, 0]), float(self.along[0])
        return along**2 / power if power > NOTHING**2 else 0.0

    def scaled(self, times: float) -> Scores:
        """Return the scores of columns that are so many times as large."""
        if times == 1.0:
            return self
        squared = times**2
        return Scores(
            times * self.along, squared * self.information, squared * self.whole,
            times * self.explained, times * self.moves,
        )  # fmt: skip

    @classmethod
    def alike(cls, each: Sequence[Scores]) -> Scores:
        """Return the scores of the sum of single columns that show in different rows, of one test."""
        along, explained, moves = (
            np.sum([getattr(s, name) for s in each], axis=0) for name in ("along", "explained", "moves")
        )
        whole = sum(s.whole for s in each)
        return cls(along, np.maximum(whole - explained.T @ moves, 0.0), whole, explained, moves)

    @classmethod
    def of(cls, test: ScoreTest, jacobian: Columns, across: Columns, whitened: Columns) -> Scores:
        """Return the scores of whitened columns, (rows q, k), without and with what the fit explains of them."""
        along, information = products(across, test.left), products(across, across)
        explained = products(jacobian, whitened)
        return cls(along, information, square(whitened), explained, test.moves(explained))

    @classmethod
    def of_each(cls, test: ScoreTest, jacobian: Columns, whitened: Columns) -> list[Scores]:
        """Return the scores of each of k whitened columns, (rows q, k), by itself."""
        told = test.of_whitened(whitened, jacobian=jacobian)
        assert told.explained is not None
        moves = test.moves(told.explained)
        return [
            cls(told.along[own], told.power[own, None], float(told.whole[k]), told.explained[:, own], moves[:, own])
            for k, own in enumerate(slice(k, k + 1) for k in range(len(told.power)))
        ]


@dataclass(frozen=True)
class Addition:
    """A candidate addition to an explanation: nuisance parameters or columns.

    Attributes
    ----------
    gain : float
        The fall of z'z to first order.
    starts : values of nuisance parameters at which a refit starts
    free : nuisance parameters that it frees
    linear : Linear or None
    scores : Scores or None
        What the score test says of its columns.
    across : (rows q, k) array
        Whitened columns without their part that the fit explains, for a unit of each, where they were asked for.
    tried : int
        Of how many tried values it is the best; of columns that exclude each other each is one of so many.
    usual, unit : float, str
        Its usual size, where it is of one number; 0: none is known.
    again : bool
        Another recording has the same: what a bench does to one it is likely to do to the next.
    parts : of what is added to several recordings at once, what is added to each
    untold : bool
        No such recording tells it, whatever rounding, or a voltage of nearly nothing, seems to show.
    foretold : values between which all such recordings have it
    """

    effect: Effect
    name: str
    numbers: int
    gain: float
    starts: tuple[Mapping[str, float], ...] = ()
    free: tuple[str, ...] = ()
    linear: Linear | None = None
    scores: Scores | None = None
    across: FloatArray | None = None
    tried: int = 1
    usual: float = 0.0
    unit: str = ""
    again: bool = False
    untold: bool = False
    foretold: tuple[float, float] | None = None
    parts: tuple[Addition, ...] = ()

    def penalty(self, samples: int) -> float:
        """Return its penalty in the criterion."""
        one_of = self.tried if self.linear is not None else 1
        numbers = 0 if self.is_foretold else self.numbers
        return numbers * math.log(max(samples, 2)) + 2 * math.log(one_of / self.prior)

    @property
    def prior(self) -> float:
        """Its prior probability."""
        return max(AGAIN, self.effect.prior) if self.again or self.is_foretold else self.effect.prior

    @property
    def is_foretold(self) -> bool:
        """Whether it is no number that is free: all such recordings have it, or show its coefficient elsewhere."""
        return self.foretold is not None or (self.linear is not None and self.linear.foretold)

    def shows_in(self, simulator: Simulator) -> NDArray[np.intp]:
        """Return the places of the outputs in which it shows; all, where it moves the motor."""
        if self.linear is not None:
            return np.flatnonzero(self.linear.columns.any(axis=(0, 2)))
        channels = {n.channel for n in simulator.nuisances if n.name in (*self.free, self.name)}
        own = [j for j, y in enumerate(simulator.outputs) if y in channels]
        return np.array(own or range(len(simulator.outputs)), dtype=np.intp)

    @property
    def has_known_size(self) -> bool:
        """Whether its numbers have a usual size, which is a prior deviation of each."""
        return self.linear is None or self.linear.size > 0

    @cached_property
    def usual_scores(self) -> Scores:
        """What its score test says of its columns for a usual size of each; for a unit where none is known."""
        assert self.scores is not None
        return self.scores.scaled(self.linear.size) if self.linear is not None and self.linear.size else self.scores

    def posterior(self, part: float = 1.0) -> tuple[FloatArray, FloatArray, float]:
        """Return what its score test tells of it beside its prior, which is of a part of its usual size.

        Returns
        -------
        Its numbers, (k,), in such sizes, their covariance, (k, k), and by how much the evidence with it is above that
        without (`Explanation.evidence`).
        """
        scores, known = self.usual_scores.scaled(part), self.has_known_size
        k = len(scores.information)
        information = scores.information + (np.eye(k) if known else 0.0)
        spread = np.asarray(np.linalg.pinv(information) if k > 1 else 1 / information)
        numbers = spread @ scores.along
        charge = OPEN * k
        if known:
            charge = float(np.linalg.slogdet(information)[1] if k > 1 else np.log(information[0, 0]))
        sizes = 2 if self.effect.small else 1  # each of them is as likely
        charge += 2 * math.log(sizes * self.tried / self.prior)
        return numbers, spread, charge - float(scores.along @ numbers)


def together(parts: Sequence[Addition]) -> Addition:
    """Return nuisance parameters of several recordings as one addition, from the start of each one's largest fall."""
    start = {name: value for a in parts for name, value in a.starts[0].items()}
    free = tuple(name for a in parts for name in a.free)
    name, gain = f"{parts[0].effect.name} of each recording", sum(a.gain for a in parts)
    return Addition(parts[0].effect, name, len(free), gain, starts=(start,), free=free, parts=tuple(parts))


def without_columns(addition: Addition) -> Addition:
    """Return an addition without its columns."""
    return dataclasses.replace(addition, scores=None, across=None)


def is_switch(addition: Addition) -> bool:
    """Whether an addition is a switch of the drive that the recordings show before any fit, such as an open circuit."""
    return bool(np.isinf(addition.gain)) and not addition.free


def is_sure(fit: Fit, addition: Addition) -> bool:
    """Whether all such recordings have what an addition is, of its size in a fit: nothing else can be in its place."""
    return addition.foretold is not None and addition.foretold[0] <= fit.value(addition.name) <= addition.foretold[1]


def is_timing(addition: Addition) -> bool:
    """Whether an addition is a nuisance parameter of what happens within samples: a delay, a filter, a mean."""
    return addition.effect.sharp and not addition.effect.is_line and addition.linear is None


def is_held(fit: Fit) -> bool:
    """Whether a motor parameter that never vanishes is at a bound of a fit."""
    return any(end != 0 and name in NEVER_ZERO for name, end in zip(fit.names, fit.at_bound, strict=True))


def is_physical(fit: Fit, addition: Addition, *, before: Fit | None = None) -> bool:
    """Whether an addition's values are within the bounds of its effect, and it takes no motor parameter's place.

    Parameters
    ----------
    before : Fit, optional
        Without it: a parameter that a bound holds there too is not held for it, if it explains most of what is missed.
    """
    held_before = before is not None and is_held(before) and fit.cost < MOST * before.cost
    if is_held(fit) and not held_before:
        return False
    if addition.linear is not None:
        return all(addition.linear.least <= x <= addition.linear.most for x in fit.estimates_of(addition.name))
    s = fit.simulator
    for name in addition.free:
        k = s.index[name]
        neutral, value = s.neutral[name], fit.values[k]
        at_end = min(value - s.lower[k], s.upper[k] - value) <= 1e-6 * (s.upper[k] - s.lower[k])
        if at_end and abs(value - neutral) > 1e-6 * (s.upper[k] - s.lower[k]):
            return False
    return True


def has_its_needs(fit: Fit, addition: Addition) -> bool:
    """Whether what an addition makes no sense without is there too."""
    return _needs(fit, addition) <= set(fit.free)


def is_needed(fit: Fit, addition: Addition, additions: Sequence[Addition]) -> bool:
    """Whether another addition makes no sense without this one."""
    return any(_needs(fit, other) & set(addition.free) for other in additions if other is not addition)


def _needs(fit: Fit, addition: Addition) -> set[str]:
    return {n.needs for n in fit.simulator.nuisances if n.name in addition.free and n.needs}


def alike(one: Addition, other: Addition) -> float:
    """Return the largest canonical correlation of two additions' columns, without what the fit explains."""
    if one.across is None or other.across is None or len(one.across) != len(other.across):
        return 0.0
    first, second = (np.linalg.qr(a)[0] for a in (one.across, other.across))
    return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])


def wald(fit: Fit, addition: Addition) -> float:
    """Return the Wald statistic of an addition: the square of its numbers over their covariance."""
    names = list(fit.names)
    covariance, at_bound, estimates = fit.covariance(), fit.at_bound, fit.estimates
    wanted = addition.free if addition.linear is None else tuple(
        n for n in names if n.partition('#')[0] == addition.name and n not in fit.free
    )  # fmt: skip
    total = 0.0
    for name in wanted:
        k = names.index(name)
        s = fit.simulator
        neutral = s.neutral.get(name, 0.0)
        if at_bound[k] == 0 and covariance[k, k] > 0:
            off = np.log(estimates[k] / neutral) if fit.is_log[k] else estimates[k] - neutral
            total += float(off**2 / covariance[k, k])
    return total if wanted else np.inf


def apart(additions: Sequence[Addition]) -> list[Addition]:
    """Return those columns of a ranking that show in other samples than those before them."""
    found: list[Addition] = []
    taken: NDArray[np.bool_] = np.zeros(1, dtype=bool)
    for a in additions:
        if a.linear is None:
            continue
        there = a.linear.columns.any(axis=2)
        if not np.any(there & taken):
            taken = np.asarray(there | taken)
            found.append(a)
    return found
