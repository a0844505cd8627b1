"""First-order response of a DC motor to additional voltage or torque. Knows R, K, L, J, B; no FMU, no noise.

Where the drive opens the circuit at no voltage there is no current, and the motor coasts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from estimator.fitting.fit import Fit
from estimator.fitting.lateness import acting, channel_delay
from estimator.fitting.simulator import Simulator, per_recording
from estimator.motor.exponential import exponential
from estimator.motor.names import MOTOR, is_motor
from estimator.motor.state_space import coasting, matrices, sampled_with_angle
from estimator.noise.clock import Clock
from estimator.noise.kalman import filters
from estimator.noise.recursion import recursion
from estimator.stepping import layout

FloatArray = NDArray[np.float64]
Openings = NDArray[np.uint8]  # of each row: 0, OPEN or ENDS

SEATS = {"i": 0, "w": 1, "angle": 2}
STATES, MEAN_SPEED = (0, 1, 2), 3  # seats of response_run
COASTS = "coasts"  # 1: the drive opens the circuit where its command is zero
ONE_WAY = "one_way"  # 1: the drive lets no current flow back
FINELY = 8  # parts of a row, where the voltage moves within it
OPEN, ENDS = 1, 2  # no current flows in a row, or one that still flows at its instant ends within it
NO_CURRENT = 1e-3  # of the largest: less is none, where no current flows back


def motor_values(fit: Fit) -> Mapping[str, float] | None:
    """Return R, K, L, J, B where the fit is a DC motor's and its sensors show current or speed; else None."""
    return fit.once(_motor_values)


def _motor_values(fit: Fit) -> Mapping[str, float] | None:
    s = fit.simulator
    values = {**s.plan.fixed, **dict(zip(s.names, fit.values.tolist(), strict=True))}
    if not is_motor(values) or "v" not in s.observed[0].inputs or not set(s.outputs) <= set(SEATS):
        return None
    return values


def speed_of(fit: Fit, shown: FloatArray) -> FloatArray | None:
    """Return the speed of shown signals, (rows, q), rad/s, or that of their angle; None where neither is compared.

    Of a mean since the row before it is that of two, about the row.
    """
    s = fit.simulator
    if "w" not in s.outputs and "angle" not in s.outputs:
        return None
    own = shown[:, s.outputs.index("w" if "w" in s.outputs else "angle")]
    if "w" in s.outputs and s.plan.sensors["w"] != layout.MEAN:
        return own
    w = own.copy()
    for rows, step in ((clock.rows, clock.step) for clock in s.clocks):
        if "w" in s.outputs:
            w[rows][:-1] = 0.5 * (own[rows][:-1] + own[rows][1:])
        else:
            w[rows] = np.gradient(own[rows], step)
    return w


def machine_of(fit: Fit) -> tuple[tuple[FloatArray, FloatArray] | None, tuple[int, ...]]:
    """Return A (2, 2), b (2,) of d[i, w]/dt = A x + b torque, torque against the motion, and the channels' states."""
    values = motor_values(fit)
    if values is None:
        return None, tuple(-1 for _ in fit.simulator.outputs)
    a, b, _, _ = matrices(values)
    return (a, b[:, 1]), tuple(SEATS[y] if y != "angle" else -1 for y in fit.simulator.outputs)


def with_machine(fit: Fit) -> Fit:
    """Return the fit whose noise knows the machine as it is now, and where its circuit is open."""
    machine, seat = machine_of(fit)
    opens = None if machine is None else openings(fit)
    noise = dataclasses.replace(fit.whitener.noise, machine=machine, seat=seat)
    is_open = opens > 0 if opens is not None and opens.any() else None
    return dataclasses.replace(fit, whitener=dataclasses.replace(fit.whitener.of(noise), opens=is_open))


def response(
    fit: Fit, *, voltage: FloatArray | None = None, torque: FloatArray | None = None, within: Clock | None = None
) -> FloatArray:
    """Return the change of the sensors' signals, (rows, q), by inputs that are held over each row.

    Parameters
    ----------
    voltage, torque : (rows,) arrays
        V; N.m against positive speed. Or (rows, c), c of them, which change the signals by (rows, q, c).
    within : Clock, optional
        The recording whose rows these are; else they are those of all.
    """
    s = fit.simulator
    rows = s.rows if within is None else len(within.time)
    given = [None if signal is None else signal.reshape(rows, -1) for signal in (voltage, torque)]
    many = max(signals.shape[1] for signals in given if signals is not None)
    result = np.zeros((rows, len(s.outputs), many))
    opens, seats, motor = openings(fit), _plain_seats(fit), motor_values(fit)
    assert motor is not None
    for clock in s.clocks if within is None else (within,):
        there = clock.rows if within is None else slice(None)
        own = [None if signals is None else signals[there] for signals in given]
        if seats is not None:
            _driven(motor, clock.step, own, opens[clock.rows], np.zeros((2, many)), (seats, result[there]))
            continue
        states = _driven(motor, clock.step, own, opens[clock.rows], np.zeros((2, many)))
        each = [_later(fit, clock, own, opens[clock.rows], states, channel_delay(s, fit.value, y)) for y in s.outputs]
        for k in range(many):
            result[there, :, k] = _as_shown(fit, [own[:, :, k].T for own in each], clock)
    one = all(signal is None or signal.ndim == 1 for signal in (voltage, torque))
    return result[:, :, 0] if one else result


def late_response(fit: Fit, voltage: FloatArray) -> FloatArray:
    """Return the change of the sensors' signals, (rows, q), by a voltage, V, that is as late as a recording's inputs.

    It is held from row to row, (rows,), or c of them, (rows, c), for (rows, q, c); exact for delays between rows. Where
    the recorded one goes on lines between its jumps, so does it; then a delay between rows leaves out their corners.
    """
    values = motor_values(fit)
    assert values is not None
    if "v" in fit.simulator.plan.case.linear:
        return _response_on_lines(fit, values, voltage)
    of_motor, clocks = tuple(values[name] for name in MOTOR), fit.simulator.clocks
    late = [divmod(fit.delay(e) / clock.step, 1.0) for e, clock in enumerate(clocks)]
    if not any(part for _, part in late):
        return response(fit, voltage=as_late(fit, voltage) if any(whole for whole, _ in late) else voltage)
    held = np.zeros((2, *voltage.shape))  # a voltage and a torque that do the same from row to row
    for (whole, part), clock in zip(late, clocks, strict=True):
        old, new = (_moved(voltage[clock.rows], int(whole) + more) for more in (1, 0))
        if part == 0:
            held[0, clock.rows] = new
            continue
        f, g = (matrix[:2, :2] for matrix in _sampled(of_motor, (1 - part) * clock.step))
        before, whole_row = (_sampled(of_motor, step)[1][:2] for step in (part * clock.step, clock.step))
        shares = np.linalg.solve(whole_row, np.column_stack([f @ before[:, 0], g[:, 0]]))
        for signal, (of_old, of_new) in zip(held, shares.tolist(), strict=True):
            signal[clock.rows] = of_old * old + of_new * new
    held[1][openings(fit) > 0] = 0.0  # nothing drives a motor whose circuit is open
    return response(fit, voltage=held[0], torque=held[1])


def _response_on_lines(fit: Fit, values: Mapping[str, float], voltage: FloatArray) -> FloatArray:
    """Return the same of a voltage on lines from row to row."""
    s, late = fit.simulator, as_late(fit, voltage)
    held = np.zeros((2, *late.shape))  # a voltage and a torque that do the same from row to row
    for e, (o, clock) in enumerate(zip(s.observed, s.clocks, strict=True)):
        own = late[clock.rows]
        then = np.concatenate([own[1:], own[-1:]])
        if (jumps := o.jumps.get("v")) is not None:  # up to them it is held
            before = np.flatnonzero(_moved(jumps.astype(np.float64), round(fit.delay(e) / clock.step)) > 0) - 1
            then[before[before >= 0]] = own[before[before >= 0]]
        whole = np.zeros((4, 4))  # current, speed, voltage, its slope
        a, b, _, _ = matrices(values)
        whole[:2, :2], whole[:2, 2], whole[2, 3] = a, b[:, 0], 1 / clock.step
        g = _sampled(tuple(values[name] for name in MOTOR), clock.step)[1][:2]
        shares = np.linalg.solve(g, exponential(whole * clock.step)[:2, 2:])
        for signal, (of_own, of_change) in zip(held, shares.tolist(), strict=True):
            signal[clock.rows] = of_own * own + of_change * (then - own)
    held[1][openings(fit) > 0] = 0.0
    return response(fit, voltage=held[0], torque=held[1])


def _plain_seats(fit: Fit) -> list[int] | None:
    """Return which state, or mean speed, each output shows as it is; None where a sensor acts on one, or is late."""
    s, value = fit.simulator, fit.value
    if any(acting(s, value, y) or channel_delay(s, value, y) or y in s.plan.chains for y in s.outputs):
        return None
    return [MEAN_SPEED if s.plan.sensors[y] == layout.MEAN else SEATS[y] for y in s.outputs]


def opens_circuit(fit: Fit, recording: int) -> bool:
    """Whether the drive of a recording opens the circuit where its command is zero."""
    s = fit.simulator
    names = (COASTS, per_recording(s.plan, COASTS)[recording])
    return any(name in s.index and fit.value(name) == 1.0 for name in names)


def openings(fit: Fit) -> Openings:
    """Return in which rows no current flows, (rows,): OPEN, ENDS within the row, or 0."""
    s = fit.simulator
    opens = np.zeros(s.rows, dtype=np.uint8)
    where = [clock.rows for e, clock in enumerate(s.clocks) if opens_circuit(fit, e)]
    if where:
        off = as_late(fit, (s.inputs("v") == 0).astype(np.float64)) > 0.5
        for rows in where:
            opens[rows] = off[rows]
    if ONE_WAY in s.index and fit.value(ONE_WAY) == 1.0:
        if "i" in s.outputs:
            i = np.abs(fit.shown[:, s.outputs.index("i")])
            none = i <= NO_CURRENT * np.max(i)
            for clock in s.clocks:
                own = none[clock.rows]
                ends = np.append(own[1:], own[-1])  # in the row in which one begins it flows
                opens[clock.rows] = np.where(ends, np.where(own, OPEN, ENDS), opens[clock.rows])
        else:
            opens[as_late(fit, (s.inputs("v") == 0).astype(np.float64)) > 0.5] = OPEN
    return opens


def _driven(
    values: Mapping[str, float],
    step: float,
    inputs: Sequence[FloatArray | None],
    opens: Openings,
    first_row: FloatArray,
    shown: tuple[Sequence[int], FloatArray] | None = None,
) -> FloatArray:
    """Return changes of current, speed and angle, (n, 3, c), by those of voltage and torque, (n, c), held over rows.

    Parameters
    ----------
    values, step : R, K, L, J, B; a sampling interval, s
    first_row : (2, c) array
        Changes in the first row.
    shown : q seats and a (n, q, c) array, contiguous, optional
        Which of both are wanted, in which order, and where they go.
    """
    f, g = _sampled(tuple(values[name] for name in MOTOR), step)
    (n,), many = opens.shape, first_row.shape[1]
    seats, states = (STATES, np.empty((n, len(STATES), many))) if shown is None else shown
    signals = [None if u is None else np.ascontiguousarray(u, dtype=np.float64) for u in inputs]
    given = (*map(np.ascontiguousarray, (f[:, :2], g, np.array(coasting(values, step)), opens)), *signals)
    arrays = (*given, np.ascontiguousarray(first_row, dtype=np.float64), np.array(seats, dtype=np.int64), states)
    filters().response_run(n, len(seats), many, step, *(None if a is None else a.ctypes.data for a in arrays))
    return states


def driven_on_lines(
    values: Mapping[str, float],
    clock: Clock,
    corners: tuple[FloatArray, FloatArray, FloatArray],
    opens: Openings,
) -> FloatArray:
    """Return current, speed and angle, (n, 3), of a motor by a voltage on lines, exact wherever in a row it changes.

    Parameters
    ----------
    values : R, K, L, J, B
    corners : (m,) arrays
        Times, s, that rise, and by how much the voltage, 0 before, jumps there, V, and its slope changes, V/s.
    opens : (n,) array
        Rows in which no current flows.
    """
    times, jumps, slopes = corners
    a, b, _, _ = matrices(values)
    whole = np.zeros((4, 4))  # current, speed, voltage, its slope
    whole[:2, :2], whole[:2, 2], whole[2, 3] = a, b[:, 0], 1.0
    n, h, at = len(opens), clock.step, times - clock.time[0]
    now = h * np.arange(n)
    begun = np.searchsorted(at, now, side="right")
    jumped, slope, bent = (np.append(0.0, np.cumsum(x))[begun] for x in (jumps, slopes, slopes * at))
    voltage = jumped + slope * now - bent
    added = np.column_stack([voltage, slope]) @ exponential(whole * h)[:2, 2:].T
    for row, part, change in zip((at // h).astype(int), at % h, np.column_stack([jumps, slopes]), strict=True):
        if 0 <= row < n and part > 0:
            added[row] += exponential(whole * (h - part))[:2, 2:] @ change
    g = _sampled(tuple(values[name] for name in MOTOR), h)[1][:2]
    held = np.linalg.solve(g, added.T)[:, :, None]  # a voltage and a torque that do the same from row to row
    held[1][opens > 0] = 0.0
    return _driven(values, h, [held[0], held[1]], opens, np.zeros((2, 1)))[:, :, 0]


def pulse_response(fit: Fit, clock: Clock, begin: float, end: float) -> FloatArray:
    """Return the change of the sensors' signals, (n, q), by 1 V from `begin` to `end`, s of a recording's own time.

    Exact for any instants, also between the rows; the sign is turned where `end` comes first.
    """
    s, values = fit.simulator, motor_values(fit)
    assert values is not None
    jumps = np.array([1.0, -1.0] if begin <= end else [-1.0, 1.0])
    closed = np.zeros(clock.rows.stop - clock.rows.start, dtype=np.uint8)
    delays = [channel_delay(s, fit.value, y) for y in s.outputs]
    known = {}
    for delay in set(delays):
        times = np.array(sorted((begin, end))) + delay
        known[delay] = driven_on_lines(values, clock, (times, jumps, np.zeros(2)), closed).T
    return _as_shown(fit, [known[delay] for delay in delays], clock)


def free_motion(fit: Fit, clock: Clock, *, opens_first: bool = False) -> FloatArray:
    """Return the change of the sensors' signals, (n, q, 2), by 1 rad/s and by 1 A in a recording's first row.

    Parameters
    ----------
    opens_first : bool
        Whether a drive that opens the circuit at no voltage has done so before the first voltage too.
    """
    opens, motor = openings(fit)[clock.rows], motor_values(fit)
    assert motor is not None
    if not opens_first:
        driven = as_late(fit, (fit.simulator.inputs("v") != 0).astype(np.float64))[clock.rows] > 0.5
        opens = opens * (np.cumsum(driven) > 0)
    first = np.zeros((2, 2))
    first[1, 0] = first[0, 1] = 1.0
    if (seats := _plain_seats(fit)) is not None:
        shown = np.empty((len(opens), len(seats), 2))
        _driven(motor, clock.step, (None, None), opens, first, (seats, shown))
        return shown
    s, nothing = fit.simulator, (None, None)
    states = _driven(motor, clock.step, nothing, opens, first)
    each = [_later(fit, clock, nothing, opens, states, channel_delay(s, fit.value, y)) for y in s.outputs]
    return np.stack([_as_shown(fit, [own[:, :, k].T for own in each], clock) for k in range(2)], axis=2)


def as_late(fit: Fit, signal: FloatArray) -> FloatArray:
    """Return an input's signals, (rows,) or (rows, c), as late as the inputs of a recording, on lines between rows."""
    s = fit.simulator
    result = np.zeros(signal.shape)
    for e, clock in enumerate(s.clocks):
        whole, part = divmod(fit.delay(e) / clock.step, 1.0)
        x = signal[clock.rows]
        for by, share in ((int(whole), 1 - part), (int(whole) + 1, part)):
            if share == 0:
                continue
            result[clock.rows] += share * _moved(x, by)
    return result


def _moved(signal: FloatArray, rows: int) -> FloatArray:
    """Return a signal, (n,) or (n, c), as it was some rows before, or comes to be after some; 0 where it is not."""
    moved = np.zeros(signal.shape)
    if rows >= 0:
        moved[rows:] = signal[: max(len(signal) - rows, 0)]
    else:
        moved[:rows] = signal[-rows:]
    return moved


def as_current(fit: Fit, signal: FloatArray, *, rows_late: int = 0) -> FloatArray:
    """Return what the sensors show, (rows, q), of a signal that adds to the current, (rows,), as late as the inputs."""
    return beside_current(fit, as_late(fit, signal), rows_late=rows_late)


def beside_current(fit: Fit, signal: FloatArray, *, rows_late: int = 0) -> FloatArray:
    """Return what the sensors show, (rows, q), of a signal that adds to the current, (rows,)."""
    s = fit.simulator
    result = np.zeros((s.rows, len(s.outputs)))
    for clock in s.clocks if "i" in s.outputs else ():
        whole, part = divmod(channel_delay(s, fit.value, "i") / clock.step, 1.0)
        states = np.zeros((3, clock.rows.stop - clock.rows.start))
        for more, share in ((0, 1 - part), (1, part)):
            states[0] += share * _moved(signal[clock.rows], int(whole) + rows_late + more)
        result[clock.rows, s.outputs.index("i")] = _as_shown_by(fit, "i", states, clock)
    return result


def held_for_wave(fit: Fit, clock: Clock, frequency: float) -> tuple[FloatArray, FloatArray]:
    """Return voltage and torque, (n, 2) each, V and N.m, held over rows, that do what cos and sin of 1 V do.

    The frequency, Hz, may be any: one above half of the sampling rate, too. Its phase is that of the recording's time.
    """
    values = motor_values(fit)
    assert values is not None
    a, b, _, _ = matrices(values)
    f, g = (matrix[:2, :2] for matrix in _sampled(tuple(values[name] for name in MOTOR), clock.step))
    turning = 2j * np.pi * frequency
    added = np.linalg.solve(turning * np.eye(2) - a, (np.exp(turning * clock.step) * np.eye(2) - f) @ b[:, 0])
    held = np.linalg.solve(g.astype(complex), added)
    waves = np.exp(turning * clock.time)[:, None] * held
    voltage, torque = (np.column_stack([wave.real, wave.imag]) for wave in waves.T)
    return voltage, torque


def response_within_rows(fit: Fit, change: FloatArray) -> FloatArray:
    """Return the change of the sensors' signals, (rows, q), by a voltage that moves on a line within each row, as late.

    Parameters
    ----------
    change : (rows,) array
        By how much from the row to the next, V; its mean over each row is none.
    """
    s, values = fit.simulator, motor_values(fit)
    assert values is not None
    opens, result = openings(fit), np.zeros((s.rows, len(s.outputs)))
    line = (np.arange(FINELY) + 0.5) / FINELY - 0.5
    for e, clock in enumerate(s.clocks):
        h = clock.step / FINELY
        voltage = _moved((change[clock.rows][:, None] * line).ravel(), round(fit.delay(e) / h))
        open_parts = np.repeat(opens[clock.rows], FINELY)
        states = _driven(values, h, [voltage[:, None], None], open_parts, np.zeros((2, 1)))[:, :, 0]
        for j, y in enumerate(s.outputs):
            own = _moved(_read(s, y, states.T, h, apart=FINELY), round(channel_delay(s, fit.value, y) / h))
            acts = [(n, n.act) for n in s.nuisances if n.output == y and fit.value(n.name) != n.neutral]
            for n, act in acts:
                if n.between and act is not None:
                    own = act(own, fit.value(n.name), h)
            own = _through_chain(s, y, own[::FINELY], clock)
            for n, act in acts:
                if not n.between and act is not None:
                    own = act(own, fit.value(n.name), clock.step)
            result[clock.rows, j] = own
    return result


@lru_cache(maxsize=64)
def _sampled(values: tuple[float, ...], step: float) -> tuple[FloatArray, FloatArray]:
    """Return F, (3, 3), and G, (3, 2), of x[k+1] = F x[k] + G [v, torque], of R, K, L, J, B and an interval, s."""
    return sampled_with_angle(dict(zip(MOTOR, values, strict=True)), step)


def _later(
    fit: Fit,
    clock: Clock,
    inputs: Sequence[FloatArray | None],
    opens: Openings,
    states: FloatArray,
    delay: float,
) -> FloatArray:
    """Return changes of the states, (n, 3, c), as they were a delay before each row, s, by inputs as `_driven`.

    Between two rows they are those of inputs that are held, or, where the circuit is open, on lines.
    """
    if delay == 0:
        return states
    whole, part = divmod(delay / clock.step, 1.0)
    n = len(states)
    row = np.arange(n) - int(whole) - (part > 0)  # at or before that instant
    at, since = np.clip(row, 0, n - 1), (1 - part) % 1.0
    shown = states[at]
    if since > 0:
        values = motor_values(fit)
        assert values is not None
        f, g = _sampled(tuple(values[name] for name in MOTOR), since * clock.step)
        on = states[np.minimum(at + 1, n - 1)]
        driven = np.einsum("ab,nbc->nac", f, shown)
        for k, signals in enumerate(inputs):
            if signals is not None:
                driven += g[:, k, None] * signals[at][:, None, :]
        shown = np.where(opens[at][:, None, None] > 0, shown + since * (on - shown), driven)
    shown[row < 0] = states[0]
    return shown


def _as_shown(fit: Fit, states: Sequence[FloatArray], clock: Clock) -> FloatArray:
    """Return the states, (3, n) for each output, as the outputs' sensors show them, (n, q)."""
    shown = [_as_shown_by(fit, y, own, clock) for y, own in zip(fit.simulator.outputs, states, strict=True)]
    return np.column_stack(shown)


def _as_shown_by(fit: Fit, output: str, states: FloatArray, clock: Clock) -> FloatArray:
    """Return the states, (3, n), as an output's sensor shows them, (n,)."""
    s = fit.simulator
    shown = sensed(s, output, states, clock)
    for act, value in acting(s, fit.value, output):
        shown = act(shown, value, clock.step)
    return shown


def sensed(s: Simulator, output: str, states: FloatArray, clock: Clock) -> FloatArray:
    """Return current, speed and angle, (3, n), as an output shows them, (n,), by all that is declared of it."""
    return _through_chain(s, output, _read(s, output, states, clock.step), clock)


def _read(s: Simulator, output: str, states: FloatArray, step: float, *, apart: int = 1) -> FloatArray:
    """Return what is read of the states, (3, n), some rows of `step` s apart: one of them, or the mean of the speed."""
    if s.plan.sensors[output] != layout.MEAN:
        return np.asarray(states[SEATS[output]])
    angle = states[SEATS["angle"]]
    return np.asarray((angle - _moved(angle, apart)) / (apart * step))


def _through_chain(s: Simulator, output: str, shown: FloatArray, clock: Clock) -> FloatArray:
    """Return a signal, (n,), behind the mean, the filters and the gain that are declared of an output."""
    chain = s.plan.chains.get(output)
    if chain is None:
        return shown
    if chain.average > 1:
        before = np.repeat(shown[:1], chain.average - 1)
        own = np.full(chain.average, 1 / chain.average)
        shown = recursion(own, (), np.concatenate([before, shown]))[len(before) :]
    for b0, b1, b2, a1, a2 in chain.sections(clock.step):
        shown = recursion((b0, b1, b2), (a1, a2), shown)
    return np.asarray(chain.gain * shown)
