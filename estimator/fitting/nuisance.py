"""What the measurement chain adds to a fit: delay, offsets, averages, ripple, outliers. Knows plans and fits, no FMU.

After a first polish each nuisance that is still fixed is asked how much it would improve the fit: the residuals are
projected on its direction, free of what the parameters explain. The strongest is freed, the fit repeated, and it stays
free only if its value then differs from its default by more than FREED standard deviations (with the standard errors
of the noise as it is, coloured or not); else it stays fixed, so that clean data keep their small errors. Ripple locked
to the angle and outliers are taken out of the residuals in the same rounds.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.directions import (
    AVERAGES,
    LATE_CURRENT,
    Direction,
    as_well,
    default_of,
    directions,
    late_as_well,
    starts,
)
from estimator.fitting.drift import with_drift
from estimator.fitting.fit import (
    Fit,
    at_given_bound,
    chi_square,
    colours,
    inflation,
    log_likelihood,
    misfit,
    squares,
    weighed,
    with_coloured_errors,
)
from estimator.fitting.freeing import FREED, free_delay, named, with_average, with_place, without
from estimator.fitting.lost_samples import can_be_set_right, put_back
from estimator.fitting.noise import find_outliers
from estimator.fitting.phases import with_phases
from estimator.fitting.polish import LeastSquares, Polish
from estimator.fitting.problem import Problem
from estimator.fitting.suspects import LOST, renewed, strongest_suspect
from estimator.fitting.treatment import Accused, Treatment, find_treatment
from estimator.fitting.widening import widened
from estimator.plans.plan import ChainSpec, Plan
from estimator.recordings.excitation import quantum
from estimator.recordings.samples import mean_of_known
from estimator.stepping import layout

FloatArray = NDArray[np.float64]

ROUNDS = 8
COUNTED = 1.3  # times the deviation of one count, 1/√12: more is not explained by counting
HOPELESS = 5.0  # times that deviation, by a rough fit
OUTLIERS = 3  # fewer do no harm that is not seen
HUBER, HUBER_PASSES = 1.5, 4  # deviations
SMOOTH = 0.3  # correlation of neighbours, of a mean over n samples 1 − 1/n
NUMERICAL = 1e-6  # of a signal's deviation: residuals below are the FMU's, not noise


@dataclass
class Refinement:
    """Free what improves the fit.

    Parameters
    ----------
    rebuild : callable
        A plan with other nuisances → a problem.
    """

    rebuild: Callable[[Plan], Problem]
    rejected: set[str] = field(default_factory=set)
    plain: Plan | None = None  # before anything is freed

    def run(self, problem: Problem, polish: Polish) -> Fit:
        """Return the fit with the nuisances that earn their place."""
        problem, polish = self._wanted(problem, polish)
        self.plain = problem.plan
        untreated = Fit(problem, polish, Treatment.none(len(polish.residuals), len(problem.outputs)))
        if at_given_bound(problem.plan, polish):  # then what does not fit is the bound's doing
            return with_coloured_errors(untreated)
        polish = self._robust(problem, polish)
        fit = self._treated(dataclasses.replace(untreated, polish=polish))
        if self._is_numerical(fit):
            return fit
        fit = with_phases(fit, self.rebuild)
        fit = self._counted(fit) or fit
        if self._is_smooth(fit):  # before a mean is taken for a delay or for a friction
            fit = self._mean_or_late(fit) or fit
        tried_averages = False
        for _ in range(ROUNDS):
            better = self._step(fit, channels=tried_averages)
            if better is None and not tried_averages:
                tried_averages = True
                better = self._mean_or_late(fit)
                if better is not None:
                    self.rejected.clear()
                better = better or self._step(fit, channels=True)
            better = better or self._counted(fit)
            if better is None:
                break
            fit = better
        return widened(with_coloured_errors(self._without_idle(fit)))

    def _robust(self, problem: Problem, polish: Polish) -> Polish:
        """Where there are outliers, fit again with them held down (Huber): in the transient they bend the fit."""
        raw = problem.residuals(polish.values[None, :])[0]
        parts = [series for j in range(len(problem.outputs)) for series, _ in problem.series(raw, j)]
        if sum(int(find_outliers(series).sum()) for series in parts) < OUTLIERS:
            return polish
        output = problem.output_of_residual
        values = polish.values
        for _ in range(HUBER_PASSES):
            raw = problem.residuals(values[None, :])[0]
            spread = np.array([np.median(np.abs(raw[output == j])) for j in range(len(problem.outputs))]) / 0.6745
            held = np.minimum(1.0, HUBER / np.maximum(np.abs(raw) / np.maximum(spread, 1e-300)[output], 1e-300))
            least = LeastSquares(
                lambda candidates, held=held: problem.residuals(candidates) * np.sqrt(held),  # type: ignore[misc]
                problem.box,
                output=output,
                spread=problem.spread,
            )
            values, _ = least.fit(values, np.maximum(spread, 1e-12 * problem.spread), tolerance=1e4)
        found = squares(problem, Treatment.none(len(raw), len(problem.outputs)))
        return found.judge(values, found.deviations(values, free=len(values)))

    def _counted(self, fit: Fit) -> Fit | None:
        """Add a differenced encoder's speed up to counts again; None unless the model then explains it to a count.

        Their noise is white, that of their differences anything but: least squares on counts lose nothing.
        """
        plan = fit.problem.plan
        j = plan.outputs.index("w") if "w" in plan.outputs else -1
        if (
            plan.counted
            or j < 0
            or plan.sensors["w"] != layout.MEAN
            or plan.chains.get("w", ChainSpec()) != ChainSpec()
        ):
            return None
        steps = [quantum(o.outputs["w"]) * o.recording.step for o in plan.observed]
        broken = any(np.isnan(o.outputs["w"]).any() or o.lead or not o.recording.even for o in plan.observed)
        if broken or min(steps) <= 0 or "offset w" in plan.names or "gain w" in plan.names:
            return None
        problem = self.rebuild(dataclasses.replace(plan, counted=True))
        size = len(problem.output_of_residual)
        start = fit.polish.deviations.copy()
        start[j] = max(steps) / np.sqrt(12)
        plain = dataclasses.replace(Treatment.none(size, len(plan.outputs)), accused=fit.treatment.accused)
        _, rough = squares(problem, plain).quick(fit.polish.values, start)
        if rough[j] > HOPELESS * start[j]:
            return None
        polish = squares(problem, plain).polish(fit.polish.values, start)
        found = self._treated(dataclasses.replace(fit, problem=problem, polish=polish, treatment=plain), again=True)
        return found if found.polish.deviations[j] < COUNTED * start[j] else None

    def _step(self, fit: Fit, *, channels: bool) -> Fit | None:
        """Free the strongest nuisance, or accuse the strongest suspect, whichever explains more; None if none does."""
        if any(a.name == LOST and len(a.rows) for a in fit.treatment.accused):
            return None  # taken out to first order: what is left of it would look like a delay
        for _ in range(ROUNDS):
            gain, direction = self._strongest(fit, channels=channels)
            smooth = not channels and self._is_smooth(fit)  # a mean that is not found yet looks like anything
            suspect = None if smooth else strongest_suspect(fit)
            accused = self._accused(fit, suspect) if suspect is not None and suspect.deviations**2 > gain else None
            if accused is not None and (rather := self._rather(fit, accused)) is not None:
                self.rejected.clear()
                return rather
            if accused is not None and direction is not None and direction.unit is not None:
                _, direction = self._strongest(fit, channels=channels, means=False)  # a mean is no rival to a suspect
            if direction is None:
                return accused and self._weighed(fit, accused)
            freed = self._freed(fit, direction)
            if accused is not None and (freed is None or misfit(accused) < misfit(freed)):
                return self._weighed(fit, accused)
            if freed is not None:
                self.rejected.clear()
                return freed if smooth else self._weighed(fit, freed, direction)
            self.rejected.add(direction.name)
        return None

    def _weighed(self, fit: Fit, taken: Fit, direction: Direction | None = None) -> Fit:
        """Return a fit with an accusation or with what was freed, or the rival that explains far more.

        Where an accusation or a gain explains nearly as much as the best, it is kept, so that the estimate is
        doubtful, and what else does so is told.

        Parameters
        ----------
        direction : Direction or None
            What was freed; None for an accusation.
        """
        rivals: list[tuple[Fit, Direction | None]] = []
        is_mean = direction is not None and direction.unit is not None
        if direction is None or is_mean:
            rivals = [(r, d) for d in directions(fit) if (r := self._rival(fit, d, gains=not is_mean)) is not None]
        elif (direction.is_channel or direction.is_gain) and (suspect := strongest_suspect(fit)) is not None:
            rivals = [(self._accused(fit, suspect), None)]
        every = [(taken, direction), *rivals]
        lowest = min(_score(f) for f, _ in every)
        near = [(f, d) for f, d in every if _score(f) <= lowest + FREED**2]
        doubtful = [f for f, d in near if d is None or d.is_gain]
        if not doubtful:
            return taken if near[0][0] is taken else min(near, key=lambda n: _score(n[0]))[0]
        best = min(doubtful, key=_score)
        told = tuple(as_well(f, d) for f, d in near if f is not best and (d is None or d.unit is None))
        return dataclasses.replace(best, nearly=(*best.nearly, *told))

    def _rival(self, fit: Fit, direction: Direction, *, gains: bool) -> Fit | None:
        """Free a channel's delay, or its gain, that may explain what an accusation does; None if it does not."""
        if not (direction.is_channel or (gains and direction.is_gain)) or direction.name in self.rejected:
            return None
        product, power = self._first_order(fit, direction)
        if power == 0:
            return None
        return self._freed(fit, dataclasses.replace(direction, starts=starts(direction, -product / power, fit.problem)))

    def _accused(self, fit: Fit, suspect: Accused) -> Fit:
        """Take a wrong assumption out of the residuals, and fit again."""
        treatment = dataclasses.replace(fit.treatment, accused=(*fit.treatment.accused, suspect))
        self.rejected.clear()
        found = self._treated(dataclasses.replace(fit, treatment=treatment), again=True)
        if suspect.name == LOST:  # the places move with the fit
            return self._set_right(found, suspect) or found
        last = renewed(found, suspect)
        treatment = dataclasses.replace(found.treatment, accused=(*fit.treatment.accused, last))
        return self._treated(dataclasses.replace(found, treatment=treatment), again=True)

    def _rather(self, fit: Fit, taken: Fit) -> Fit | None:
        """Return a current that comes late, or a mean of it, that explains far more than what was taken for true."""
        late = self._late_current(fit)
        if late is None:
            return None
        near = dataclasses.replace(fit.polish, values=late.polish.values[: len(fit.polish.values)])
        mean = self._averaged(dataclasses.replace(fit, polish=near), even_if_white=True)
        best = late
        if mean is not None and (gap := _score(mean, like=fit) - _score(late, like=fit)) < FREED**2:
            best = mean if gap < -(FREED**2) else dataclasses.replace(mean, nearly=(*mean.nearly, late_as_well(late)))
        return best if _score(best, like=fit) < _score(taken, like=fit) - FREED**2 else None

    def _mean_or_late(self, fit: Fit) -> Fit | None:
        """Return a mean of the current, if one fits, or a current that comes late if that explains far more."""
        mean = self._averaged(fit)
        return None if mean is None else self._rather(fit, mean) or mean

    def _late_current(self, fit: Fit) -> Fit | None:
        """Free the delay of all outputs and, against it, that of the speed; None unless that is below zero."""
        plan = fit.problem.plan
        name = named("delay", plan, 0)
        pair = {d.name: d for d in directions(fit) if d.name in (name, "delay w")}
        if len(pair) < 2:
            return None
        late = plan.observed[0].recording.step
        problem = self.rebuild(pair["delay w"].extend(pair[name].extend(plan, late), -late))
        x = np.concatenate([fit.polish.values, [late, -late]])
        polish = squares(problem, fit.treatment).polish(x, fit.polish.deviations)
        if polish.values[-1] >= 0:
            return None
        sentences = (*fit.freed, pair[name].sentence, LATE_CURRENT)
        freed = Fit(problem, polish, fit.treatment, freed=sentences, names=(*fit.names, name, "delay w"))
        return self._treated(freed)

    def _set_right(self, fit: Fit, lost: Accused) -> Fit | None:
        """Put rows that were lost back where that explains the recording as well as their effect to first order."""
        if lost.size < 0 or not can_be_set_right(fit.problem.plan):
            return None
        bare = self._without_what_was_freed(fit)
        tried = [self._with_rows_back(f, lost) for f in (fit, bare) if f is not None]
        found = min(tried, key=lambda f: _score(f, like=fit))
        return found if _score(found, like=fit) < _score(fit) + FREED**2 else None

    def _with_rows_back(self, fit: Fit, lost: Accused) -> Fit:
        """Put rows that were lost back; again if the current turns out to be a mean on the right clock."""
        found = self._treated(put_back(fit, lost, self.rebuild), again=True)
        mean = self._averaged(found)
        if mean is None:
            return found
        return self._treated(put_back(mean, mean.treatment.accused[-1], self.rebuild), again=True)

    def _without_what_was_freed(self, fit: Fit) -> Fit | None:
        """Return a fit, not polished, without what a wrong clock may have freed; an encoder's phase stays."""
        plan, gone = fit.problem.plan, [n for n in fit.names if " angle" not in n]
        if not gone:
            return None
        kept = [p.name not in gone for p in plan.parameters]
        parameters = tuple(p for p in plan.parameters if p.name not in gone)
        first = self.plain or plan
        plan = dataclasses.replace(plan, parameters=parameters, sensors=first.sensors, chains=first.chains)
        problem = self.rebuild(plan)
        polish = dataclasses.replace(fit.polish, values=fit.polish.values[kept])
        told = [(n, s) for n, s in zip(fit.names, fit.freed, strict=True) if n not in gone]
        names, freed = tuple(n for n, _ in told), tuple(s for _, s in told)
        return dataclasses.replace(fit, problem=problem, polish=polish, names=names, freed=freed)

    def _without_idle(self, fit: Fit) -> Fit:
        """Fix again what was freed at first and has become insignificant beside what was freed later."""
        judged = with_coloured_errors(fit).polish
        for j, parameter in enumerate(fit.problem.parameters):
            place = parameter.place
            if place is None or place.output == "angle" or judged.at_bound[j] or place in fit.problem.plan.wanted:
                continue
            if abs(judged.values[j] - default_of(parameter.name)) > FREED * judged.standard_errors[j]:
                continue
            problem = self.rebuild(without(fit.problem.plan, parameter.name))
            x = np.delete(fit.polish.values, j)
            polish = squares(problem, fit.treatment).polish(x, fit.polish.deviations)
            kept = [(n, s) for n, s in zip(fit.names, fit.freed, strict=True) if n != parameter.name]
            names, freed = tuple(n for n, _ in kept), tuple(s for _, s in kept)
            fixed = self._treated(Fit(problem, polish, fit.treatment, names=names, freed=freed))
            return self._without_idle(fixed)
        return fit

    def _is_smooth(self, fit: Fit) -> bool:
        """Whether neighbouring residuals of the current are alike in the second half, where all has settled."""
        if "i" not in fit.problem.outputs:
            return False
        for series, _ in fit.problem.series(fit.polish.residuals, fit.problem.outputs.index("i")):
            late = series[len(series) // 2 :]
            late = late - mean_of_known(late)
            if mean_of_known(late[1:] * late[:-1]) > SMOOTH * mean_of_known(late * late):
                return True
        return False

    def _wanted(self, problem: Problem, polish: Polish) -> tuple[Problem, Polish]:
        """Free what the case frees."""
        plan = problem.plan
        for place in plan.wanted:
            plan = with_place(plan, place)
        if plan is problem.plan:
            return problem, polish
        added = [p.start or 0.0 for p in plan.parameters[len(polish.values) :]]
        problem = self.rebuild(plan)
        least = squares(problem, Treatment.none(len(polish.residuals), len(problem.outputs)))
        return problem, least.polish(np.concatenate([polish.values, added]), polish.deviations)

    def delayed(self, problem: Problem, polish: Polish) -> tuple[Problem, Polish]:
        """Free the delays that the data show at first sight; a delay that turns out to be none goes."""
        plan = problem.plan
        late = [e for e, o in enumerate(plan.observed) if o.delay != 0 and f"delay of {e}" not in plan.declared]
        if not late:
            return problem, polish
        for e in late:
            plan = free_delay(plan, e, plan.observed[e].delay)
        problem = self.rebuild(plan)
        least = squares(problem, Treatment.none(len(polish.residuals), len(problem.outputs)))
        h = plan.observed[late[0]].recording.step
        tried = []
        for shift in (0.0, -1.0, 0.5):
            start = [(p.start or 0.0) + shift * h for p in plan.parameters[len(polish.values) :]]
            values, found = least.quick(np.concatenate([polish.values, start]), polish.deviations)
            tried.append((log_likelihood(problem, found), values))
        return problem, least.polish(min(tried, key=lambda t: t[0])[1], polish.deviations)

    def _is_numerical(self, fit: Fit) -> bool:
        return bool(np.all(fit.polish.deviations < NUMERICAL * fit.problem.spread))

    def _freed(self, fit: Fit, direction: Direction) -> Fit | None:
        """Free one nuisance; None if it does not earn its place."""
        plan = fit.problem.plan
        problem = self.rebuild(direction.extend(plan, direction.starts[0]))
        least = squares(problem, fit.treatment)
        old = dict(zip(plan.names, fit.polish.values.tolist(), strict=True))
        tried = []
        for start in direction.starts:
            x = np.array([old.get(p.name, start) for p in problem.parameters])
            if len(direction.starts) > 1:
                values, found = least.quick(x, fit.polish.deviations)
                tried.append((log_likelihood(problem, found), values))
            else:
                tried.append((0.0, x))
        x = min(tried, key=lambda t: t[0])[1]
        polish = least.polish(x, fit.polish.deviations)
        best = self._treated(Fit(problem, polish, fit.treatment, freed=fit.freed, names=fit.names))
        best = dataclasses.replace(best, colours=colours(best))
        gain = chi_square(fit, best) / max(1.0, inflation(best))
        significant = gain > FREED**2
        if direction.unit is None:
            j = best.problem.plan.names.index(direction.name)
            judged = with_coloured_errors(best).polish
            significant = abs(judged.values[j] - direction.default) > FREED * judged.standard_errors[j]
        if not significant:
            return None
        sentence = direction.sentence
        if direction.is_channel and best.polish.values[best.problem.plan.names.index(direction.name)] < 0:
            sentence = direction.sentence_if_early
        return dataclasses.replace(best, freed=(*fit.freed, sentence), names=(*fit.names, direction.name))

    def _averaged(self, fit: Fit, *, even_if_white: bool = False) -> Fit | None:
        """Try running means of the current, as loggers show it, where its residuals are coloured; None if none fits."""
        plan = fit.problem.plan
        if "i" not in plan.outputs or "average i" in plan.declared or plan.chains.get("i", ChainSpec()).average != 1:
            return None
        if fit.colours[plan.outputs.index("i")].is_white and not even_if_white:
            return None
        tried: list[tuple[float, int, Problem, FloatArray]] = []
        for n in AVERAGES:
            problem = self.rebuild(with_average("i", n)(plan, 0.0))
            values, found = squares(problem, fit.treatment).quick(fit.polish.values, fit.polish.deviations)
            tried.append((log_likelihood(problem, found), n, problem, values))
            if n > 1 + min(tried, key=lambda t: t[0])[1]:
                break
        lowest, n, problem, values = min(tried, key=lambda t: t[0])
        if lowest > misfit(fit) - FREED**2:
            return None
        sentence = f"i is a mean over the last {n} samples, as the data show; the model's is taken so too"
        best = Fit(
            problem,
            squares(problem, fit.treatment).polish(values, fit.polish.deviations),
            fit.treatment,
            freed=(*fit.freed, sentence),
            names=(*fit.names, f"average i {n}"),
        )
        best = self._treated(best)
        best = dataclasses.replace(best, colours=colours(best))
        return best if chi_square(fit, best) > FREED**2 * inflation(best) else None

    def _treated(self, fit: Fit, *, again: bool = False) -> Fit:
        """Take out outliers and ripple, as the residuals show them, and fit again where that changes anything."""
        if self._is_numerical(fit):
            return fit
        raw = fit.problem.residuals(fit.polish.values[None, :])[0]
        treatment = find_treatment(fit.problem, raw, fit.polish, accused=fit.treatment.accused)
        treatment = with_drift(fit.problem, raw, fit.polish, treatment)
        same = (
            np.array_equal(treatment.keep, fit.treatment.keep)
            and treatment.ripples == fit.treatment.ripples
            and treatment.drifts == fit.treatment.drifts
        )
        if not same or again:
            polish = squares(fit.problem, treatment).polish(fit.polish.values, fit.polish.deviations)
            fit = dataclasses.replace(fit, polish=polish, treatment=treatment)
        fit = weighed(fit)
        return dataclasses.replace(fit, colours=colours(fit))

    def _first_order(self, fit: Fit, direction: Direction) -> tuple[float, float]:
        """Return a direction's product with the residuals and its power beside the parameters; 0 if they explain it."""
        jacobian = fit.polish.jacobian[:, fit.polish.at_bound == 0]
        basis = np.linalg.qr(jacobian)[0] if jacobian.shape[1] else jacobian
        column = fit.treatment.apply(direction.column[None, :], weighted=True)[0]
        across = column - basis @ (basis.T @ column)
        power = float(across @ across)
        if power <= 1e-9 * float(column @ column):
            return 0.0, 0.0
        return float(across @ fit.polish.residuals), power

    def _strongest(self, fit: Fit, *, channels: bool, means: bool = True) -> tuple[float, Direction | None]:
        """Return the nuisance that would improve the fit most, to first order, and by how much chi-square falls.

        A channel's own delay only if `channels`: a running mean explains it as well.
        """
        best: tuple[float, Direction | None] = (FREED**2, None)
        for direction in directions(fit):
            if direction.name in self.rejected or (direction.is_channel and not channels):
                continue
            if direction.unit is not None and not means:
                continue
            product, power = self._first_order(fit, direction)
            if power == 0:
                continue
            if direction.unit is None:
                gain = product**2 / power
                begin = starts(direction, -product / power, fit.problem)
                direction = dataclasses.replace(direction, starts=begin)
            else:
                gain = -2 * product * direction.unit - power * direction.unit**2
            if gain > best[0]:
                best = (gain, direction)
        return best


def _score(fit: Fit, *, like: Fit | None = None) -> float:
    """Return a fit's misfit, each sample that is left out as an outlier counted as one.

    That of another fit's number of samples if it is given.
    """
    outliers = float(np.sum(fit.treatment.keep == 0))
    return log_likelihood((like or fit).problem, fit.polish.deviations) + FREED**2 * outliers
