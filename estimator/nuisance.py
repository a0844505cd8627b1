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
from estimator.noise import Colour, Ripple, averaged, find_colour, find_outliers, find_ripple, quadratic
from estimator.parameters import Parameter, SensorPlace
from estimator.polish import LeastSquares, Polish
from estimator.problem import ChainSpec, Plan, Problem

FloatArray = NDArray[np.float64]

FREED = 4.0  # standard deviations by which a nuisance must improve the fit
ROUNDS = 8
AVERAGES = (2, 3, 4, 5, 6, 8, 10, 16)  # samples that a logger's running mean may span
DELAY_ROOM = 20.0  # samples on either side of a delay's start
DRIFTS = 5.0  # standard deviations of a drift that is taken out
DRIFT_FROM = 0.1  # of the part after the step: the colour of what follows judges a drift
SMOOTH = 5  # degree of the polynomial by which the model's angle is corrected
NUMERICAL = 1e-6  # of a signal's deviation: residuals below are the FMU's, not noise
LEAST_GAIN = 1e-3  # of the residuals' deviation over the noise: chi-square gains below are not worth a nuisance


@dataclass(frozen=True)
class Treatment:
    """What is taken out of the residuals: outliers left out, ripple projected away.

    Attributes
    ----------
    keep : (m,) array
        0 for an outlier, else 1.
    drifts : (output, how far it drifts over the recording in its unit), beyond the model
    basis : (m, r) array
        Orthonormal columns that weighted residuals are made orthogonal to.
    scale : (m,) array
        Deviations that weigh them.
    lost : (q,) array
        Degrees of freedom that each output loses.
    """

    keep: FloatArray
    basis: FloatArray
    lost: FloatArray
    scale: FloatArray
    ripples: tuple[tuple[str, Ripple], ...] = ()
    drifts: tuple[tuple[str, float], ...] = ()
    outliers: tuple[tuple[str, int], ...] = ()

    @classmethod
    def none(cls, size: int, outputs: int) -> Treatment:
        """Return the treatment that changes nothing."""
        return cls(np.ones(size), np.zeros((size, 0)), np.zeros(outputs), np.ones(size))

    def apply(self, residuals: FloatArray, *, weighted: bool = False) -> FloatArray:
        """Treat (c, m) residuals, in the outputs' units or weighted."""
        if self.keep.all() and not self.basis.shape[1]:
            return residuals
        treated = residuals * self.keep
        if weighted:
            return np.asarray(treated - (treated @ self.basis) @ self.basis.T)
        return np.asarray(treated - (((treated / self.scale) @ self.basis) @ self.basis.T) * self.scale)


@dataclass(frozen=True)
class Fit:
    """A fit with its measurement chain.

    Attributes
    ----------
    colours : of each output's residuals
    freed : sentences about the nuisances that were freed
    accused : names of freed nuisances
    """

    problem: Problem
    polish: Polish
    treatment: Treatment
    colours: tuple[Colour, ...] = ()
    freed: tuple[str, ...] = ()
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Direction:
    """A nuisance that might be freed: the plan with it, where to start, and its gain at first sight."""

    name: str
    column: FloatArray  # (m,) change of the weighted residuals for a unit of it
    unit: float | None  # for a nuisance with two states only: the size of the step; None: any size
    extend: Callable[[Plan, float], Plan]
    starts: tuple[float, ...] = (0.0,)
    sentence: str = ""


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
        fit = self._treated(Fit(problem, polish, Treatment.none(len(polish.residuals), len(problem.outputs))))
        for y in problem.outputs:  # an encoder's phase is never known
            counts = y == "angle" and all(quantum(o.outputs[y]) > 0 for o in problem.plan.observed)
            if counts and f"offset {y}" not in problem.plan.names:
                fit = self._with_phase(fit, y)
        tried_averages = False
        for _ in range(ROUNDS):
            if self._is_numerical(fit):
                break
            direction = self._strongest(fit)
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
                if found is None:
                    break
                fit = found
                self.rejected.clear()
        return fit if self._is_numerical(fit) else with_coloured_errors(fit)

    def delayed(self, problem: Problem, polish: Polish) -> tuple[Problem, Polish]:
        """Free the delays that the data show at first sight; a delay that turns out to be none goes."""
        plan = problem.plan
        late = [e for e, o in enumerate(plan.observed) if o.delay != 0]
        if not late:
            return problem, polish
        for e in late:
            plan = free_delay(plan, e, plan.observed[e].delay)
        problem = self.rebuild(plan)
        squares = _squares(problem, Treatment.none(len(polish.residuals), len(problem.outputs)))
        h = plan.observed[late[0]].recording.step
        tried = []
        for shift in (0.0, -1.0, 0.5):
            start = [(p.start or 0.0) + shift * h for p in plan.parameters[len(polish.values) :]]
            values, found = squares.quick(np.concatenate([polish.values, start]), polish.deviations)
            tried.append((_log_likelihood(problem, found), values))
        return problem, squares.polish(min(tried, key=lambda t: t[0])[1], polish.deviations)

    def _is_numerical(self, fit: Fit) -> bool:
        return bool(np.all(fit.polish.deviations < NUMERICAL * fit.problem.spread))

    def _freed(self, fit: Fit, direction: Direction) -> Fit | None:
        """Free one nuisance; None if it does not earn its place."""
        plan = fit.problem.plan
        problem = self.rebuild(direction.extend(plan, direction.starts[0]))
        squares = _squares(problem, fit.treatment)
        old = dict(zip(plan.names, fit.polish.values.tolist(), strict=True))
        tried = []
        for start in direction.starts:
            x = np.array([old.get(p.name, start) for p in problem.parameters])
            if len(direction.starts) > 1:
                values, found = squares.quick(x, fit.polish.deviations)
                tried.append((_log_likelihood(problem, found), values))
            else:
                tried.append((0.0, x))
        x = min(tried, key=lambda t: t[0])[1]
        polish = squares.polish(x, fit.polish.deviations)
        best = self._treated(Fit(problem, polish, fit.treatment, freed=fit.freed, names=fit.names))
        best = dataclasses.replace(best, colours=_colours(best))
        gain = _chi_square(fit, best) / max(1.0, _inflation(best))
        significant = gain > FREED**2
        if direction.unit is None:
            j = best.problem.plan.names.index(direction.name)
            judged = with_coloured_errors(best).polish
            default = 1.0 if direction.name.startswith("gain") else 0.0
            significant = abs(judged.values[j] - default) > FREED * judged.standard_errors[j]
        if not significant:
            return None
        return dataclasses.replace(best, freed=(*fit.freed, direction.sentence), names=(*fit.names, direction.name))

    def _with_phase(self, fit: Fit, output: str) -> Fit:
        problem = self.rebuild(_with_offset(f"offset {output}", output)(fit.problem.plan, 0.0))
        x = np.append(fit.polish.values, 0.0)
        polish = _squares(problem, fit.treatment).polish(x, fit.polish.deviations)
        fit = dataclasses.replace(fit, problem=problem, polish=polish)
        return dataclasses.replace(
            fit,
            colours=_colours(fit),
            freed=(*fit.freed, f"{output} is an encoder's, in counts: its phase is estimated"),
        )

    def _averaged(self, fit: Fit) -> Fit | None:
        """Try running means of the current, as loggers show it, where its residuals are coloured; None if none fits."""
        plan = fit.problem.plan
        if "i" not in plan.outputs or plan.chains.get("i", ChainSpec()).average != 1:
            return None
        if fit.colours[plan.outputs.index("i")].is_white:
            return None
        tried: list[tuple[float, int, Problem, FloatArray]] = []
        for n in AVERAGES:
            problem = self.rebuild(_with_average("i", n)(plan, 0.0))
            values, found = _squares(problem, fit.treatment).quick(fit.polish.values, fit.polish.deviations)
            tried.append((_log_likelihood(problem, found), n, problem, values))
            if n > 1 + min(tried, key=lambda t: t[0])[1]:
                break
        misfit, n, problem, values = min(tried, key=lambda t: t[0])
        if misfit > _misfit(fit) - FREED**2:
            return None
        sentence = f"i is a mean over the last {n} samples, as the data show; the model's is taken so too"
        best = Fit(
            problem,
            _squares(problem, fit.treatment).polish(values, fit.polish.deviations),
            fit.treatment,
            freed=(*fit.freed, sentence),
            names=(*fit.names, f"average i {n}"),
        )
        best = self._treated(best)
        best = dataclasses.replace(best, colours=_colours(best))
        return best if _chi_square(fit, best) > FREED**2 * _inflation(best) else None

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
            return dataclasses.replace(fit, colours=_colours(fit))
        polish = _squares(fit.problem, treatment).polish(fit.polish.values, fit.polish.deviations)
        fit = dataclasses.replace(fit, polish=polish, treatment=treatment)
        return dataclasses.replace(fit, colours=_colours(fit))

    def _strongest(self, fit: Fit) -> Direction | None:
        jacobian = fit.polish.jacobian[:, fit.polish.at_bound == 0]
        basis = np.linalg.qr(jacobian)[0] if jacobian.shape[1] else jacobian
        residuals = fit.polish.residuals
        best: tuple[float, Direction | None] = (FREED**2, None)
        for direction in self._directions(fit):
            if direction.name in self.rejected:
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
            name = _named("delay", plan, e)
            if name not in free and o.excitation.kind != "none":
                slope = [-np.gradient(y, axis=0) / o.recording.step if r == e else 0 * y for r, y in enumerate(shown)]
                column = problem.spread_out(slope) * weights[problem.output_of_residual]
                sentence = f"{o.recording.title}: the outputs come later than the input; the delay is estimated"
                directions.append(Direction(name, column, None, _with_delay(name, e), sentence=sentence))
        for j, y in enumerate(plan.outputs):
            name = f"offset {y}"
            if name not in free:
                ones = [np.zeros_like(s) for s in shown]
                for s in ones:
                    s[:, j] = 1.0
                column = problem.spread_out(ones) * weights[problem.output_of_residual]
                sentence = f"{y} has an offset; it is estimated"
                directions.append(Direction(name, column, None, _with_offset(name, y), sentence=sentence))
            chain = plan.chains.get(y, ChainSpec())
            if chain.average == 1 and plan.sensors[y] == layout.IDENTITY and y == "w":
                for n in AVERAGES[1:]:
                    change = [np.zeros_like(s) for s in shown]
                    for s, full in zip(change, shown, strict=True):
                        s[:, j] = _running_mean(full[:, j], n) - full[:, j]
                    column = problem.spread_out(change) * weights[problem.output_of_residual]
                    sentence = f"{y} is a mean over the last {n} samples, as the data show; the model's is taken so too"
                    directions.append(
                        Direction(f"average {y} {n}", column, 1.0, _with_average(y, n), sentence=sentence)
                    )
                if y == "w" and any(v.name == "angle" for v in plan.description.variables):
                    change = [np.zeros_like(s) for s in shown]
                    for s, full in zip(change, shown, strict=True):
                        s[1:, j] = 0.5 * (full[:-1, j] - full[1:, j])
                    column = problem.spread_out(change) * weights[problem.output_of_residual]
                    sentence = "w is a mean over the sampling interval, as differenced encoder counts are"
                    directions.append(Direction("mean w", column, 1.0, _with_mean, sentence=sentence))
        return directions


def with_coloured_errors(fit: Fit) -> Fit:
    """Return the fit with the sandwich covariance of its residuals' colour."""
    colours = fit.colours or _colours(fit)
    polish = fit.polish
    told = np.isfinite(np.diag(polish.covariance))
    if all(c.is_white for c in colours) or not told.any():
        return dataclasses.replace(fit, colours=colours)
    middle = np.zeros((len(polish.values), len(polish.values)))
    for j, colour in enumerate(colours):
        middle += quadratic(fit.problem.spread_columns(polish.jacobian, j), colour)
    powers, axes = np.linalg.eigh(middle)
    half = polish.covariance[np.ix_(told, told)] @ (axes * np.sqrt(np.maximum(powers, 0.0)))[told]
    covariance = polish.covariance.copy()
    covariance[np.ix_(told, told)] = half @ half.T  # never negative, however little the data tell
    scale = np.where(fit.problem.box.log, polish.values, 1.0)
    errors = np.sqrt(np.diag(covariance)) * np.abs(scale)
    polish = dataclasses.replace(polish, covariance=covariance, standard_errors=errors, scores=middle)
    return dataclasses.replace(fit, polish=polish, colours=colours)


def find_treatment(problem: Problem, raw: FloatArray, polish: Polish) -> Treatment:
    """Return what to take out of (m,) residuals, in the outputs' units."""
    plan, m, q, values = problem.plan, len(raw), len(problem.outputs), polish.values
    scale = polish.deviations[problem.output_of_residual]
    keep, lost = np.ones(m), np.zeros(q)
    columns: list[FloatArray] = []
    ripples: list[tuple[str, Ripple]] = []
    outliers: list[tuple[str, int]] = []
    for j, name in enumerate(problem.outputs):
        for e, (series, index) in enumerate(problem.series(raw, j)):
            far = find_outliers(series)
            if far.any():
                keep[index[far]] = 0.0
                outliers.append((name, int(far.sum())))
            series = np.where(far, np.nan, series)
            start = onset(problem, e, values)
            angle = turned(problem, e, raw)
            if angle is None or name == "angle" or find_colour([series]).is_white:
                continue
            found, waves = find_ripple(
                series,
                angle,
                onset=start,
                average=plan.chains.get(name, ChainSpec()).average,
                envelope=_speed_share(plan, e) if name == "w" else None,
                least=0.5 * quantum(plan.observed[e].outputs[name]),
            )
            for r in range(waves.shape[1]):
                column = np.zeros(m)
                known = index >= 0
                column[index[known]] = waves[known, r]
                columns.append(column * keep)
            ripples += [(name, ripple) for ripple in found]
            lost[j] += waves.shape[1]
        lost[j] += float(np.sum(keep[problem.output_of_residual == j] == 0))
    basis = np.linalg.qr(np.column_stack(columns) / scale[:, None])[0] if columns else np.zeros((m, 0))
    treatment = Treatment(keep, basis, lost, scale, ripples=tuple(ripples), outliers=tuple(outliers))
    drifts, slow = find_drift(problem, treatment.apply(raw[None, :])[0], values)
    if drifts:
        columns += [column * keep for column in slow.T]
        basis = np.linalg.qr(np.column_stack(columns) / scale[:, None])[0]
        treatment = dataclasses.replace(treatment, basis=basis, drifts=drifts, lost=lost + 1)
    return treatment


def find_drift(
    problem: Problem, residuals: FloatArray, values: FloatArray
) -> tuple[tuple[tuple[str, float], ...], FloatArray]:
    """Return what drifts over the recording while the shaft turns, and columns, (m, c), that take it out.

    Friction or a winding that warms up move current and speed slowly, in proportion to the speed: a straight line in
    time, with its zero in the middle of the part after the step, so that the parameters stand for the mean.
    """
    plan, m = problem.plan, len(residuals)
    drifts: list[tuple[str, float]] = []
    columns = []
    for j, name in enumerate(problem.outputs):
        if name == "angle" or len(plan.observed) > 1 or plan.observed[0].excitation.kind != "step":
            return (), np.zeros((m, 0))
        (series, index), known = problem.series(residuals, j)[0], ~np.isnan(problem.series(residuals, j)[0][0])
        w = plan.observed[0].outputs.get("w")
        start = onset(problem, 0, values)
        n = len(series)
        if w is None or n - start < 500:
            return (), np.zeros((m, 0))
        speed = _filled(w)
        final = float(np.mean(speed[-(n - start) // 2 :]))
        ramp = np.clip(np.where(np.arange(n) > start, speed / final if final else 0.0, 0.0), 0.0, 1.0)
        line = ramp * (np.arange(n) - (start + n) / 2) / (n - start)
        used = line * known
        size = float(used @ np.nan_to_num(series)) / float(used @ used)
        late = np.where(np.arange(n) > start + DRIFT_FROM * (n - start), series, np.nan)
        colour = find_colour([late - np.nanmean(late) - size * (line - np.mean(line))])
        error = float(np.sqrt(quadratic([used[:, None]], colour)[0, 0])) / float(used @ used)
        if abs(size) > DRIFTS * error:
            drifts.append((name, size))
        column = np.zeros(m)
        column[index[known]] = used[known]
        columns.append(column)
    if drifts and {"R", "K", "L", "J", "B"} <= {*plan.names, *plan.fixed}:
        columns = _motor_drift(problem, values)
    return tuple(drifts), np.column_stack(columns)


def _motor_drift(problem: Problem, values: FloatArray) -> list[FloatArray]:
    """Return what a friction and a resistance that drift by their own size over the recording would change, (m,) each.

    To first order the motor responds to the torque and to the voltage that the drift takes: B w(t) s(t), R i(t) s(t),
    with s(t) a straight line through zero in the middle of the part after the step.
    """
    plan = problem.plan
    known = {**dict(zip(plan.names, values.tolist(), strict=True)), **plan.fixed}
    R, K, L, J, B = (known[n] for n in ("R", "K", "L", "J", "B"))
    o, start = plan.observed[0], onset(problem, 0, values)
    h, n = o.recording.step, len(o.recording.time)
    system = np.array([[-R / L, -K / L, 1 / L, 0.0], [K / J, -B / J, 0.0, -1 / J], [0, 0, 0, 0], [0, 0, 0, 0]])
    E = _exponential(system * h)
    jump = o.excitation.after - o.excitation.before
    line = (np.arange(n) - (start + n) / 2) / max(n - start, 1)
    base = np.zeros((n, 2))
    shift = np.zeros((2, n, 2))
    i = w = 0.0
    d = [[0.0, 0.0], [0.0, 0.0]]
    (a, b, c, e), (f, g, p, q) = E[0].tolist(), E[1].tolist()
    for k in range(n):
        base[k] = i, w
        shift[0, k], shift[1, k] = d[0], d[1]
        voltage = jump if k >= start else 0.0
        torque, drop = B * w * line[k], R * i * line[k]
        d = [
            [a * d[0][0] + b * d[0][1] + e * torque, f * d[0][0] + g * d[0][1] + q * torque],
            [a * d[1][0] + b * d[1][1] - c * drop, f * d[1][0] + g * d[1][1] - p * drop],
        ]
        i, w = a * i + b * w + c * voltage, f * i + g * w + p * voltage
    index = [("i", "w").index(y) for y in plan.outputs]
    return [problem.spread_out([rows[:, index]]) for rows in shift]


def _exponential(A: FloatArray) -> FloatArray:
    """Return e^A, by squaring."""
    halvings = max(0, int(np.ceil(np.log2(max(float(np.abs(A).sum(axis=1).max()), 1e-300)))) + 4)
    x = A / 2.0**halvings
    term = total = np.eye(len(A))
    for k in range(1, 14):
        term = term @ x / k
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


def _speed_share(plan: Plan, recording: int) -> FloatArray:
    """Return the measured speed, (n,), over its largest."""
    w = _filled(plan.observed[recording].outputs["w"])
    smooth = np.convolve(np.pad(w, 2, mode="edge"), np.ones(5) / 5, mode="valid")
    return np.asarray(smooth / max(float(np.max(np.abs(smooth))), 1e-300))


def onset(problem: Problem, recording: int, values: FloatArray) -> int:
    """Return the sample at which the input acts first, delay included."""
    o = problem.plan.observed[recording]
    delay = o.delay
    for p, value in zip(problem.parameters, values, strict=True):
        if p.place is not None and p.place.kind == "delay" and p.place.recording in (None, recording):
            delay = float(value)
    return o.excitation.index + int(np.floor(delay / o.recording.step))


def turned(problem: Problem, recording: int, raw: FloatArray) -> FloatArray | None:
    """Return the shaft's angle, (n,) rad, as measured or from the measured speed; None without either.

    Encoder counts add up without error. The noise of another speed does not: there the model's speed is integrated
    and corrected by what is smooth of its difference to the measured one.
    """
    plan = problem.plan
    o = plan.observed[recording]
    if "angle" in o.outputs:
        return _filled(o.outputs["angle"])
    if "w" not in o.outputs:
        return None
    w = _filled(o.outputs["w"])
    if plan.sensors.get("w") == layout.MEAN:
        return np.asarray(np.cumsum(w) * o.recording.step)
    error = np.nan_to_num(problem.series(raw, problem.outputs.index("w"))[recording][0])
    time = np.linspace(-1.0, 1.0, len(w))
    model, wrong = (
        np.concatenate([[0.0], np.cumsum((x[1:] + x[:-1]) / 2)]) * o.recording.step for x in (w + error, -error)
    )
    chance = float(np.std(error)) * o.recording.step * np.sqrt(len(w))  # how far noise alone would walk
    if float(np.max(np.abs(wrong))) < 4 * chance:
        return np.asarray(model)
    smooth = np.polynomial.legendre.legfit(time, wrong, SMOOTH)
    return np.asarray(model + np.polynomial.legendre.legval(time, smooth))


def _filled(y: FloatArray) -> FloatArray:
    known = np.flatnonzero(~np.isnan(y))
    return np.interp(np.arange(len(y)), known, y[known])


def _squares(problem: Problem, treatment: Treatment) -> LeastSquares:
    return LeastSquares(
        lambda candidates: treatment.apply(problem.residuals(candidates)),
        problem.box,
        output=problem.output_of_residual,
        spread=problem.spread,
        lost=treatment.lost,
    )


def _colours(fit: Fit) -> tuple[Colour, ...]:
    residuals = np.where(fit.treatment.keep > 0, fit.polish.residuals, np.nan)
    return tuple(
        find_colour([series for series, _ in fit.problem.series(residuals, j)]) for j in range(len(fit.problem.outputs))
    )


def _misfit(fit: Fit) -> float:
    """Return −2 log likelihood, up to a constant, of independent normal noise of unknown deviations."""
    return _log_likelihood(fit.problem, fit.polish.deviations)


def _log_likelihood(problem: Problem, deviations: FloatArray) -> float:
    counts = np.bincount(problem.output_of_residual, minlength=len(problem.outputs))
    return float(np.sum(2 * counts * np.log(deviations)))


def _chi_square(old: Fit, new: Fit) -> float:
    return _misfit(old) - _misfit(new)


def _inflation(fit: Fit) -> float:
    """Return how much larger low frequencies are in the residuals than white ones would be, at most."""
    return max((float(np.max(c.spectrum(64)[:8])) / max(c.variance, 1e-300) for c in fit.colours), default=1.0)


def _starts(direction: Direction, start: float, problem: Problem) -> tuple[float, ...]:
    if not direction.name.startswith("delay"):
        return (start,)
    h = problem.plan.observed[0].recording.step
    start = float(np.clip(start, -5 * h, 5 * h))
    near = np.floor(start / h) * h
    return tuple(dict.fromkeys((start, near + 0.5 * h, near + 1.5 * h if start - near > 0.5 * h else near - 0.5 * h)))


def _named(kind: str, plan: Plan, recording: int) -> str:
    return kind if len(plan.observed) == 1 else f"{kind} {plan.observed[recording].recording.name}"


def delay_parameter(plan: Plan, recording: int, start: float) -> Parameter:
    """Return a free delay of one recording, around a start in s."""
    h = plan.observed[recording].recording.step
    return Parameter(
        name=_named("delay", plan, recording),
        unit="s",
        lower=start - DELAY_ROOM * h,
        upper=start + DELAY_ROOM * h,
        log=False,
        targets=(),
        start=start,
        place=SensorPlace("delay", recording),
    )


def free_delay(plan: Plan, recording: int, start: float) -> Plan:
    """Return the plan with one recording's delay free."""
    observed = list(plan.observed)
    observed[recording] = dataclasses.replace(observed[recording], delay=0.0)
    parameter = delay_parameter(plan, recording, start)
    return dataclasses.replace(plan, observed=tuple(observed), parameters=(*plan.parameters, parameter))


def _with_delay(name: str, recording: int) -> Callable[[Plan, float], Plan]:
    return lambda plan, start: free_delay(plan, recording, plan.observed[recording].delay + start)


def _with_offset(name: str, output: str) -> Callable[[Plan, float], Plan]:
    def extend(plan: Plan, start: float) -> Plan:
        spread = max(float(np.nanmax(np.abs(o.outputs[output]))) for o in plan.observed)
        parameter = Parameter(
            name=name,
            unit=plan.description.variable(output).unit,
            lower=-spread,
            upper=spread,
            log=False,
            targets=(),
            start=start,
            place=SensorPlace("offset", None, output),
        )
        return dataclasses.replace(plan, parameters=(*plan.parameters, parameter))

    return extend


def _with_average(output: str, samples: int) -> Callable[[Plan, float], Plan]:
    def extend(plan: Plan, start: float) -> Plan:
        chain = dataclasses.replace(plan.chains.get(output, ChainSpec()), average=samples)
        return dataclasses.replace(plan, chains={**plan.chains, output: chain})

    return extend


def _with_mean(plan: Plan, start: float) -> Plan:
    return dataclasses.replace(plan, sensors={**plan.sensors, "w": layout.MEAN})


def _running_mean(y: FloatArray, n: int) -> FloatArray:
    return averaged(y[:, None], n)[:, 0]
