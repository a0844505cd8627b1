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

from estimator import layout
from estimator.excitation import quantum
from estimator.fit import Fit, chi_square, colours, inflation, log_likelihood, misfit, squares, with_coloured_errors
from estimator.freeing import (
    free_delay,
    named,
    with_average,
    with_channel_delay,
    with_delay,
    with_mean,
    with_offset,
    with_place,
)
from estimator.noise import averaged
from estimator.plan import ChainSpec, Plan
from estimator.polish import Polish
from estimator.problem import Problem
from estimator.treatment import Treatment, find_treatment

FloatArray = NDArray[np.float64]

FREED = 4.0  # standard deviations by which a nuisance must improve the fit
ROUNDS = 8
AVERAGES = (2, 3, 4, 5, 6, 8, 10, 16)  # samples that a logger's running mean may span
NUMERICAL = 1e-6  # of a signal's deviation: residuals below are the FMU's, not noise


@dataclass(frozen=True)
class Direction:
    """A nuisance that might be freed: the plan with it, where to start, and its gain at first sight."""

    name: str
    column: FloatArray  # (m,) change of the weighted residuals for a unit of it
    unit: float | None  # for a nuisance with two states only: the size of the step; None: any size
    extend: Callable[[Plan, float], Plan]
    starts: tuple[float, ...] = (0.0,)
    sentence: str = ""
    is_channel: bool = False  # a delay of one channel, that a running mean explains as well


@dataclass
class Refinement:
    """Free what improves the fit.

    Parameters
    ----------
    rebuild : callable
        A plan with other nuisances → a problem.
    fixed : names of nuisances that the case fixes
    """

    rebuild: Callable[[Plan], Problem]
    evaluations: int = 30
    rejected: set[str] = field(default_factory=set)

    def run(self, problem: Problem, polish: Polish) -> Fit:
        """Return the fit with the nuisances that earn their place."""
        problem, polish = self._wanted(problem, polish)
        fit = self._treated(Fit(problem, polish, Treatment.none(len(polish.residuals), len(problem.outputs))))
        for y in problem.outputs:  # an encoder's phase is never known
            counts = y == "angle" and all(quantum(o.outputs[y]) > 0 for o in problem.plan.observed)
            for e in range(len(problem.plan.observed)) if counts else ():
                name = named(f"offset {y}", problem.plan, e)
                if name not in fit.problem.plan.names and f"offset {y}" not in problem.plan.declared:
                    fit = self._with_phase(fit, y, name, e)
        tried_averages = False
        for _ in range(ROUNDS):
            if self._is_numerical(fit):
                break
            direction = self._strongest(fit, channels=tried_averages)
            freed = self._freed(fit, direction) if direction is not None else None
            if freed is not None:
                fit = freed
                self.rejected.clear()
            elif direction is not None:
                self.rejected.add(direction.name)
            elif tried_averages:
                break
            else:
                tried_averages = True
                found = self._averaged(fit)
                if found is not None:
                    fit = found
                    self.rejected.clear()
        return fit if self._is_numerical(fit) else with_coloured_errors(fit)

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
            default = 1.0 if direction.name.startswith("gain") else 0.0
            significant = abs(judged.values[j] - default) > FREED * judged.standard_errors[j]
        if not significant:
            return None
        return dataclasses.replace(best, freed=(*fit.freed, direction.sentence), names=(*fit.names, direction.name))

    def _with_phase(self, fit: Fit, output: str, name: str, recording: int) -> Fit:
        problem = self.rebuild(with_offset(name, output, recording)(fit.problem.plan, 0.0))
        x = np.append(fit.polish.values, 0.0)
        polish = squares(problem, fit.treatment).polish(x, fit.polish.deviations)
        fit = dataclasses.replace(fit, problem=problem, polish=polish)
        return dataclasses.replace(
            fit,
            colours=colours(fit),
            freed=tuple(dict.fromkeys((*fit.freed, f"{output} is an encoder's, in counts: its phase is estimated"))),
        )

    def _averaged(self, fit: Fit) -> Fit | None:
        """Try running means of the current, as loggers show it, where its residuals are coloured; None if none fits."""
        plan = fit.problem.plan
        if "i" not in plan.outputs or "average i" in plan.declared or plan.chains.get("i", ChainSpec()).average != 1:
            return None
        if fit.colours[plan.outputs.index("i")].is_white:
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

    def _treated(self, fit: Fit) -> Fit:
        """Take out outliers and ripple, as the residuals show them, and fit again where that changes anything."""
        if self._is_numerical(fit):
            return fit
        raw = fit.problem.residuals(fit.polish.values[None, :])[0]
        treatment = find_treatment(fit.problem, raw, fit.polish)
        same = (
            np.array_equal(treatment.keep, fit.treatment.keep)
            and treatment.ripples == fit.treatment.ripples
            and treatment.drifts == fit.treatment.drifts
        )
        if same:
            return dataclasses.replace(fit, colours=colours(fit))
        polish = squares(fit.problem, treatment).polish(fit.polish.values, fit.polish.deviations)
        fit = dataclasses.replace(fit, polish=polish, treatment=treatment)
        return dataclasses.replace(fit, colours=colours(fit))

    def _strongest(self, fit: Fit, *, channels: bool) -> Direction | None:
        """Return the nuisance that would improve the fit most; a channel's own delay only if `channels`."""
        jacobian = fit.polish.jacobian[:, fit.polish.at_bound == 0]
        basis = np.linalg.qr(jacobian)[0] if jacobian.shape[1] else jacobian
        residuals = fit.polish.residuals
        best: tuple[float, Direction | None] = (FREED**2, None)
        for direction in self._directions(fit):
            if direction.name in self.rejected or (direction.is_channel and not channels):
                continue
            column = fit.treatment.apply(direction.column[None, :], weighted=True)[0]
            across = column - basis @ (basis.T @ column)
            power = float(across @ across)
            if power <= 1e-9 * float(column @ column):
                continue  # what the parameters explain cannot be told
            product = float(across @ residuals)
            if direction.unit is None:
                gain = product**2 / power
                start = -product / power
                direction = dataclasses.replace(direction, starts=_starts(direction, start, fit.problem))
            else:
                gain = -2 * product * direction.unit - power * direction.unit**2
            if gain > best[0]:
                best = (gain, direction)
        return best[1]

    def _directions(self, fit: Fit) -> list[Direction]:
        problem, plan = fit.problem, fit.problem.plan
        batch = problem.trajectories(fit.polish.values[None, :])
        shown = problem.shown(batch)
        weights = 1 / fit.polish.deviations
        free = set(plan.names)
        directions = []
        for e, o in enumerate(plan.observed):
            name = named("delay", plan, e)
            if name not in free and f"delay of {e}" not in plan.declared and o.excitation.kind != "none":
                slope = [-np.gradient(y, axis=0) / o.recording.step if r == e else 0 * y for r, y in enumerate(shown)]
                column = problem.spread_out(slope) * weights[problem.output_of_residual]
                sentence = f"{o.recording.title}: the outputs come later than the input; the delay is estimated"
                directions.append(Direction(name, column, None, with_delay(name, e), sentence=sentence))
        for j, y in enumerate(plan.outputs):
            for e, o in enumerate(plan.observed):
                name = named(f"offset {y}", plan, e)
                if name in free or f"offset {y}" in plan.declared:
                    continue
                ones = [np.zeros_like(s) for s in shown]
                ones[e][:, j] = 1.0
                column = problem.spread_out(ones) * weights[problem.output_of_residual]
                of = f" in {o.recording.title}" if len(plan.observed) > 1 else ""
                sentence = f"{y} has an offset{of}; it is estimated"
                directions.append(Direction(name, column, None, with_offset(name, y, e), sentence=sentence))
            name = f"delay {y}"
            if j > 0 and name not in free and name not in plan.declared and plan.sensors[y] == layout.IDENTITY:
                change = [np.zeros_like(s) for s in shown]
                for s, full, o in zip(change, shown, plan.observed, strict=True):
                    s[:, j] = -np.gradient(full[:, j]) / o.recording.step
                column = problem.spread_out(change) * weights[problem.output_of_residual]
                sentence = f"{y} comes later than {plan.outputs[0]}; its delay is estimated"
                extend = with_channel_delay(name, y)
                directions.append(Direction(name, column, None, extend, sentence=sentence, is_channel=True))
            chain = plan.chains.get(y, ChainSpec())
            if chain.average == 1 and plan.sensors[y] == layout.IDENTITY and y == "w":
                for n in AVERAGES[1:] if f"average {y}" not in plan.declared else ():
                    change = [np.zeros_like(s) for s in shown]
                    for s, full in zip(change, shown, strict=True):
                        s[:, j] = _running_mean(full[:, j], n) - full[:, j]
                    column = problem.spread_out(change) * weights[problem.output_of_residual]
                    sentence = f"{y} is a mean over the last {n} samples, as the data show; the model's is taken so too"
                    directions.append(Direction(f"average {y} {n}", column, 1.0, with_average(y, n), sentence=sentence))
                if "mean w" not in plan.declared and any(v.name == "angle" for v in plan.description.variables):
                    change = [np.zeros_like(s) for s in shown]
                    for s, full in zip(change, shown, strict=True):
                        s[1:, j] = 0.5 * (full[:-1, j] - full[1:, j])
                    column = problem.spread_out(change) * weights[problem.output_of_residual]
                    sentence = "w is a mean over the sampling interval, as differenced encoder counts are"
                    directions.append(Direction("mean w", column, 1.0, with_mean, sentence=sentence))
        return directions


def _starts(direction: Direction, start: float, problem: Problem) -> tuple[float, ...]:
    if not direction.name.startswith("delay"):
        return (start,)
    h = problem.plan.observed[0].recording.step
    start = float(np.clip(start, -5 * h, 5 * h))
    near = np.floor(start / h) * h
    return tuple(dict.fromkeys((start, near + 0.5 * h, near + 1.5 * h if start - near > 0.5 * h else near - 0.5 * h)))


def _running_mean(y: FloatArray, n: int) -> FloatArray:
    return averaged(y[:, None], n)[:, 0]
