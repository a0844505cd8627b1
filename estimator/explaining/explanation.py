"""An explanation: a fit and the additions that it holds, one taken away, renewed or mirrored. Knows no search.

Its criterion is z'z of whitened residuals (-2 log L at a given noise) plus the penalties of its additions.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimator.explaining.addition import Addition, is_held, is_physical, is_timing
from estimator.explaining.effects.base import Effect
from estimator.explaining.shared_errors import with_shared_errors
from estimator.fitting.fit import Fit
from estimator.fitting.gauss_newton import ITERATIONS, ROUGH, solved, solved_roughly
from estimator.fitting.simulator import Simulator
from estimator.plans.plan import Plan

MOST_ADDITIONS = 12  # additions, spectral lines and others each
MOST_IN_TWO = 2  # pairs in the place of an addition that are fitted to the end, of those that fit best
IN_NOISE = 0.1  # of z'z: by how much another form of columns may be worse by the noise that was found with the first
FOLLOWED, FALLS = 6, 0.1  # times that columns follow from the signals, at most; part of the cost that falls by it
NO_CHANGE = 0.1  # of z'z: a smaller change is negligible


@dataclass(frozen=True)
class Explanation:
    """A fit and the additions that it holds."""

    fit: Fit
    additions: tuple[Addition, ...] = ()

    def names(self) -> set[str]:
        """Return what was added."""
        return {a.name for a in self.additions}

    def is_physical(self) -> bool:
        """Return whether all that was added has values within its bounds, and takes no motor parameter's place."""
        return all(is_physical(self.fit, a) for a in self.additions)

    def criterion(self, samples: int, excess: float = 1.0) -> float:
        """Return the criterion, 1: z'z and the penalties, these as many times as `excess` says, of so many samples.

        Of columns whose form is not known the errors are charged, too: without, the less is known the less is missed.
        """
        return self.missed + excess * sum(a.penalty(samples) for a in self.additions)

    @property
    def missed(self) -> float:
        """-2 log L by the noise, 1, up to what all explanations by the same noise have."""
        return self.fit.cost + self.fit.whitener.log_shared

    def misfit(self, samples: int) -> float:
        """Return -2 log L by its own noise and the penalties, 1: explanations by noises that differ compare by it."""
        whitener = self.fit.whitener
        logs = whitener(np.zeros((*whitener.present.shape, 1)))[1] - whitener.log_shared
        return self.criterion(samples, self.excess(samples)) + logs

    def excess(self, samples: int) -> float:
        """Return z'z a sample, 1: what is missed over what the noise would leave; at least 1.

        Where the recordings are not explained, their residuals are what a fall of the cost is to be compared with:
        penalties count as many times (quasi-likelihood, Burnham and Anderson 2002, 2.5). Else nearly everything that
        may be added explains a part of what is missed, in company, and none of it is there. Of a fit that a bound holds
        this is not known: what releases it may be small.
        """
        return 1.0 if is_held(self.fit) else max(1.0, self.fit.cost / samples)

    def evidence(self, samples: int) -> float:
        """Return -2 log of its probability by Laplace's method; the usual size of a number is its prior's scale.

        Unlike the criterion, which charges log n for each number, it charges little for one that the recordings hardly
        tell, and which therefore leaves the parameters open. A number of no known size is charged log n. A number far
        above its usual size is charged for that: a winding does not warm by a seventh while a motor starts.
        """
        told, unknown = self._evidence
        return told + unknown * float(np.log(max(samples, 2)))

    @cached_property
    def _evidence(self) -> tuple[float, int]:
        """The evidence, and for how many numbers of no known size log n is charged beside it."""
        fit, sizes = self.fit, self.sizes()
        sure = {a.name for a in self.additions if a.foretold is not None}
        known = [k for k, name in enumerate(fit.names) if name in sizes.keys() - sure and fit.at_bound[k] == 0]
        charge = 0.0
        if known:
            s = np.array([sizes[fit.names[k]] for k in known])
            told = np.linalg.pinv(fit.covariance_parts()[0][np.ix_(known, known)])
            charge = float(np.linalg.slogdet(np.eye(len(s)) + told * np.outer(s, s))[1])
        unknown = sum(a.numbers for a in self.additions if a.linear is not None and a.name not in sizes)
        priors = sum(2 * float(np.log(a.tried / a.prior)) for a in self.additions)
        return self.missed + charge + priors + self._unusual(), unknown

    def _unusual(self) -> float:
        """Return -2 log of the prior of the sizes that were found, over that of small ones: Cauchy's (Jeffreys 1961).

        Its tails are long, as usual sizes are known roughly. A number's standard error widens it: of one that is hardly
        told the size is chance.
        """
        fit, s, total = self.fit, self.fit.simulator, 0.0
        usual = {a.name: a.usual for a in self.additions if a.usual}
        variances, neutral, beside = np.diag(fit.covariance_parts()[0]), s.neutral, self._tried_beside()
        for name, x, variance, is_log in zip(fit.names, fit.estimates, variances, fit.is_log, strict=True):
            if name in usual and not is_log:
                away = float(x) - neutral.get(name, 0.0)
                total += 2 * float(np.log1p(away**2 / (usual[name] ** 2 + variance)))
            elif is_log and name in beside:  # known to a factor of e about what is tried
                away = min(abs(float(np.log(x / tried))) for tried in beside[name])
                total += 2 * float(np.log1p(away**2 / (1.0 + variance)))
        return total

    def _tried_beside(self) -> dict[str, list[float]]:
        """Return what is tried of the numbers beside the first of what was added, above 0, by name."""
        s = self.fit.simulator
        found = dict[str, list[float]]()
        for a in (a for a in self.additions if len(a.free) > 1):
            for known in s.nuisance(a.name).together:
                for name, tried in known.items():
                    if name in a.free[1:] and tried > 0:
                        found.setdefault(name, []).append(tried)
        return found

    def sizes(self) -> dict[str, float]:
        """Return the usual sizes of the numbers that were added, on their scales, where they are known, by name.

        Of several numbers of an addition that is of the first; a time constant beside it is known to a factor of e.
        """
        s = self.fit.simulator
        step = {n.name: n.size for n in s.nuisances}
        found = {a.name: a.usual or step.get(a.name, 0.0) for a in self.additions}
        beside = {name for a in self.additions for name in a.free[1:] if s.log[s.index[name]]}
        return {name: abs(size) for name, size in found.items() if size} | dict.fromkeys(beside, 1.0)


def moves_ripple(explanation: Explanation, addition: Addition) -> bool:
    """Whether a ripple of an explanation lies elsewhere with an addition: behind another delay, mean or filter."""
    return is_timing(addition) and any(a.effect.is_line for a in explanation.additions)


def is_full(explanation: Explanation) -> bool:
    """Whether an explanation has more additions of the last one's kind than are taken: spectral lines, or others."""
    lines = explanation.additions[-1].effect.is_line
    return sum(a.effect.is_line == lines for a in explanation.additions) > MOST_ADDITIONS


def without(
    explanation: Explanation, addition: Addition, *, iterations: int = ROUGH, limit: float = np.inf
) -> Explanation:
    """Return the explanation, fitted again, without one of its additions; iterations and limit as for `solved`.

    What was not known of its columns' form is gone with them: it would explain what they did.
    """
    fit = explanation.fit
    if addition.linear is not None:
        of_column = [g.name != addition.name for g in fit.linear for _ in range(g.columns.shape[2])]
        gone = [g for g in fit.linear if g.name == addition.name]
        linear = tuple(g for g in fit.linear if g.name != addition.name)
        fit = dataclasses.replace(fit, linear=linear, coefficients=fit.coefficients[np.array(of_column, dtype=bool)])
        fit = with_shared_errors(fit) if any(g.uncertain is not None for g in gone) else fit
    else:
        values = fit.values.copy()
        for name in {addition.name, *addition.free}:
            values[fit.simulator.index[name]] = fit.simulator.neutral[name]
        free = tuple(n for n in fit.free if n not in addition.free)
        fit = dataclasses.replace(fit, values=values, free=free)
    rest = tuple(a for a in explanation.additions if a is not addition)
    return Explanation(solved(fit, iterations=iterations, limit=limit), rest)


def renewed(explanation: Explanation) -> Fit:
    """Return the fit with the columns of its additions computed again at its values."""
    fit, groups = explanation.fit, list(explanation.fit.linear)
    for a in explanation.additions:
        k = next((k for k, g in enumerate(groups) if g.name == a.name), None)
        if a.linear is None or k is None:
            continue
        at = sum(g.columns.shape[2] for g in groups[:k])
        own = slice(at, at + groups[k].columns.shape[2])
        bare = dataclasses.replace(
            fit,
            linear=tuple(g for g in groups if g is not groups[k]),
            coefficients=np.delete(fit.coefficients, own),
        )
        new = a.effect.renewed(bare, groups[k], fit.coefficients[own])
        if new is not None and new.columns.shape == groups[k].columns.shape:
            groups[k] = new
    return dataclasses.replace(fit, linear=tuple(groups))


def at_whole_number(fit: Fit, addition: Addition) -> Fit:
    """Return a fit at the whole number of an addition that explains most, by neighbours of one that was tried."""
    tried = {start[addition.name] for start in addition.starts}
    while True:
        beside = [k for k in addition.effect.mirrored(fit, addition.name) if k.get(addition.name, 0.0) not in tried]
        tried |= {k.get(addition.name, 0.0) for k in beside}
        near = [
            solved(dataclasses.replace(fit, values=fit.simulator.at(fit.values, k)), iterations=ROUGH) for k in beside
        ]
        best = min(near, key=lambda f: f.cost, default=fit)
        if best.cost >= fit.cost:
            return fit
        fit = best


def followed(explanation: Explanation, *, least: float | None = None) -> Explanation:
    """Return an explanation with columns by the signals that it explains by them, as long as that explains more.

    Parameters
    ----------
    least : float, optional
        By which z'z has to fall each time; without, a part of it.
    """
    for _ in range(FOLLOWED):
        again = dataclasses.replace(explanation, fit=solved_roughly(renewed(explanation)))
        if not explanation.fit.cost - again.fit.cost > (FALLS * explanation.fit.cost if least is None else least):
            break
        explanation = again
    return explanation


def named_anew(explanation: Explanation) -> Explanation:
    """Return an explanation whose additions have the names of the columns that they have been followed to."""
    groups, additions = list(explanation.fit.linear), list(explanation.additions)
    for j, a in enumerate(additions):
        k = next((k for k, g in enumerate(groups) if g.name == a.name), None)
        if k is not None and (name := a.effect.named(explanation.fit, groups[k])) not in explanation.names():
            groups[k], additions[j] = dataclasses.replace(groups[k], name=name), dataclasses.replace(a, name=name)
    fit = dataclasses.replace(explanation.fit, linear=tuple(groups))
    return dataclasses.replace(explanation, fit=fit, additions=tuple(additions))


def reshaped(explanation: Explanation, addition: Addition) -> Iterator[Explanation]:
    """Yield the explanation with an addition's columns in each other form that may explain more."""
    fit = explanation.fit
    for group in (g for g in fit.linear if g.name == addition.name):
        for other in addition.effect.reshaped(fit, group):
            linear = tuple(other if g is group else g for g in fit.linear)
            limit = fit.cost * (1 + IN_NOISE)
            tried = solved_roughly(dataclasses.replace(fit, linear=linear), limit=limit)
            if tried.cost < limit:
                yield dataclasses.replace(explanation, fit=tried)


def mirrored(
    explanation: Explanation,
    effects: Sequence[Effect],
    plan: Plan,
    *,
    of: Callable[[Addition], bool] = lambda _: True,
    iterations: int = ITERATIONS,
    limit: float,
) -> list[Explanation]:
    """Return the explanation at the equivalent values that an effect names, such as two lags exchanged.

    Of some additions; iterations and limit as for `solved`.
    """
    return [
        _at_values(explanation, a, known, effects, plan, iterations, limit=limit)
        for a in explanation.additions
        if of(a)
        for known in a.effect.mirrored(explanation.fit, a.name)
    ]


def in_two(explanation: Explanation, effects: Sequence[Effect], plan: Plan) -> list[Explanation]:
    """Return the explanation with two additions in the place of one that names such, such as a mean and a lag."""
    found = []
    for a in explanation.additions:
        rest = {other.name for other in explanation.additions if other is not a}
        excluded = {n.name: n.excludes for n in explanation.fit.simulator.nuisances}
        tried = [
            _at_values(explanation, a, known, effects, plan, 1)
            for known in a.effect.in_two(explanation.fit, a.name)
            if not any(name.startswith(excluded.get(n, ()) or "?") for n in known.keys() - rest for name in rest)
        ]
        found += sorted(tried, key=lambda e: e.fit.cost)[:MOST_IN_TWO]
    return [dataclasses.replace(e, fit=solved(e.fit)) for e in found]


def in_place_of_model(explanation: Explanation, effects: Sequence[Effect], *, limit: float) -> list[Explanation]:
    """Return the explanation with each effect that it has not and that the model's parameters may stand for.

    Limit as for `solved`.
    """
    fit, found = explanation.fit, []
    for effect in (e for e in effects if not any(a.effect is e for a in explanation.additions)):
        for known in effect.in_place_of_model(fit):
            name = next(iter(known))
            if name not in fit.simulator.index:
                continue
            values = np.clip(fit.simulator.at(fit.values, known), fit.simulator.lower, fit.simulator.upper)
            begun = dataclasses.replace(fit, values=values, free=(*fit.free, name))
            own = Addition(effect, name, 1, 0.0, free=(name,), tried=max(len(fit.simulator.nuisance(name).tries), 1))
            own = dataclasses.replace(own, usual=_nearest_try(fit.simulator, name, known[name]))
            found.append(Explanation(solved(begun, limit=limit), (*explanation.additions, own)))
    return found


def _at_values(
    explanation: Explanation,
    addition: Addition,
    known: Mapping[str, float],
    effects: Sequence[Effect],
    plan: Plan,
    iterations: int,
    *,
    limit: float = np.inf,
) -> Explanation:
    """Return the explanation at other values; nuisance parameters that come with them take an addition's place.

    They come beside it where it has a value of its own among them. Limit as for `solved`.
    """
    fit, held = explanation.fit, {a.name for a in explanation.additions}
    values, own = fit.simulator.at(fit.values, known), []
    for new in (n for n in fit.simulator.nuisances if n.tries and n.name in known and n.name not in held):
        effect = next(e for e in effects if new.name in {n.name for n in e.nuisances(plan)})
        free = () if new.whole else (new.name,)
        own.append(dataclasses.replace(addition, effect=effect, name=new.name, numbers=1, free=free))
    is_replaced = bool(own) and not known.get(addition.name)
    gone = addition.free if is_replaced else ()
    for name in {addition.name, *addition.free} - known.keys() if is_replaced and addition.linear is None else ():
        values[fit.simulator.index[name]] = fit.simulator.neutral[name]
    if own:
        freed = (n for a in own for n in a.free)
        fit = dataclasses.replace(fit, free=(*(n for n in fit.free if n not in gone), *freed))
    exchanged = solved(dataclasses.replace(fit, values=values), iterations=iterations, limit=limit)
    moved = dataclasses.replace(addition, usual=_usual_near(addition, fit.simulator, known))
    kept = [moved if a is addition else a for a in explanation.additions if not (is_replaced and a is addition)]
    return Explanation(exchanged, (*kept, *own))


def _usual_near(addition: Addition, s: Simulator, known: Mapping[str, float]) -> float:
    """Return the usual size of an addition at another value of it: that of the nearest of several tries."""
    if addition.name not in known or addition.name not in s.index or not addition.usual:
        return addition.usual
    return _nearest_try(s, addition.name, known[addition.name]) or addition.usual


def _nearest_try(s: Simulator, name: str, value: float) -> float:
    """Return the tried size of a nuisance parameter nearest to a value; 0: none, or a usual one is known."""
    nuisance = s.nuisance(name)
    away = abs(value - nuisance.neutral)
    sizes = [abs(x - nuisance.neutral) for x in nuisance.tries if x != nuisance.neutral]
    if nuisance.usual or len(sizes) < 2 or not away:
        return 0.0
    return min(sizes, key=lambda size: abs(float(np.log(size / away))))


def moved_to(fit: Fit, simulator: Simulator) -> Fit:
    """Return a fit on another simulator that knows at least its names, and may simulate what only columns are here."""
    if simulator is fit.simulator:
        return fit
    known = dict(zip(fit.simulator.names, fit.values.tolist(), strict=True))
    groups = {g.name for g in fit.linear if g.name in simulator.index and g.name not in fit.simulator.index}
    if not groups:
        return dataclasses.replace(fit, simulator=simulator, values=simulator.values(known))
    columns = dict(zip(fit.linear_names, fit.coefficients.tolist(), strict=True))
    simulated = {name: x for name, x in columns.items() if name.partition("#")[0] in groups}
    values = np.clip(simulator.values({**known, **simulated}), simulator.lower, simulator.upper)
    return dataclasses.replace(
        fit,
        simulator=simulator,
        values=values,
        free=(*fit.free, *simulated),
        linear=tuple(g for g in fit.linear if g.name not in groups),
        coefficients=np.array([x for name, x in columns.items() if name not in simulated]),
        shown=simulator.shown(values[None, :])[0],
    )


def with_added(explanation: Explanation, fit: Fit, addition: Addition) -> Explanation:
    """Return an explanation with an addition, by its fit: what this simulates is no longer added as columns."""
    additions = []
    for a in (*explanation.additions, addition):
        own = tuple(name for name in fit.free if name.partition("#")[0] == a.name)
        additions.append(dataclasses.replace(a, linear=None, free=own) if a.linear is not None and own else a)
    return Explanation(fit, tuple(additions))


def with_fine_filters(fit: Fit, *, most: int, least: float = NO_CHANGE) -> tuple[Fit, float]:
    """Return the fit on a simulator that simulates more rows between the samples if a filter there asks for it.

    Between two rows a signal may be curved, such as the current of a winding with a shorter time constant.

    Parameters
    ----------
    most : int
        Doublings of the rows, at most.
    least : float
        Of z'z: what a doubling has to change.

    Returns
    -------
    The fit, and z'z of what the last doubling changed: what is left is less.
    """
    s, left = fit.simulator, 0.0
    for _ in range(most if s.filtered(fit.values[None, :]).any() else 0):
        s.between *= 2
        finer = s.shown(fit.values[None, :])[0]
        change = fit.whitener(np.nan_to_num(finer - fit.shown)[:, :, None])[0]
        if (left := float(np.vdot(change, change))) < least:
            s.between //= 2
            break
        fit = dataclasses.replace(fit, shown=finer)
    return fit, left
