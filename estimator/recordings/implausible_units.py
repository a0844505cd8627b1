"""Units that a motor's signals and clock cannot have. Knows one recording's signals, no FMU.

Limits are those of real motors, on benches of 3 to 100 V; where nobody said the unit they are narrower.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.finding import Finding
from estimator.recordings.headers import parse_header, plain
from estimator.recordings.measured_signals import DRIVEN, MeasuredSignals
from estimator.recordings.quantum import quantum
from estimator.recordings.samples import filled, median
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

# Pairs: of a unit that a header or the user said, and of one that nobody said.
FASTEST = (3000.0, 1600.0)  # rad/s: 28 600 and 15 300 rpm
FASTEST_PER_VOLT = (600.0, 350.0)  # rad/s/V: the smallest coreless motors have 250
DEGREES, NO_RPM = 6000.0, 30_000.0  # slower numbers would be slow as deg/s, faster ones too fast as rpm
FULL_PER_VOLT = 250.0  # rad/s/V, behind a voltage of up to 1.000 V: a full duty cycle ends there
STEPPED_PER_VOLT = (
    100.0  # likewise, behind several levels below 1.000 V: one is a usual step of a volt, several are not
)
LEVELS, HELD = 3, 5  # sizes of a voltage that has several; samples of one
LARGEST_CURRENT = (150.0, 30.0)  # A, and
LEAST_RESISTANCE = (0.008, 0.025)  # Ω, of the largest voltage over the largest current
LEAST_CURRENT = 1e-3  # A: a motor that turns takes more
RISING = 2.0  # of the settled current: a larger one is that of a rotor that hardly turns yet
MOST_RESISTANCE = (20_000.0, 2000.0)  # Ω, of a motor without load, and of a rotor that hardly turns: windings have 1000
SLOWEST = (30.0, 6.0)  # s, time constant of the speed
SLOW_CLOCK = (1.0, 0.15)  # s, sampling interval at which the speed's way from level to level is seen
NO_CLOCK = (10.0, 0.95)  # s, sampling interval
US_CLOCK, US_CONSTANT = 250.0, 3000.0  # s: beyond, milliseconds would be as odd; a thousandfold, microseconds too
LEAST_CLOCK = 2e-8  # s, sampling interval
SHORTEST_CLOCK = 1e-10  # s, whoever confirms it: below, nothing a motor does is told in double precision
QUICKEST = 1e-4  # s, time constant of the speed: the least motors without iron take a millisecond
SLOW_CURRENT = 0.5  # s from a step to the peak of the current; an inductance is over in some 20 ms
DUTY = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 65535.0)  # largest values of a duty cycle: part, percent, counts
LEAST_MILLIVOLTS = 1000.0  # a motor turns at that
VOLTS = (0.2, 1000.0)  # behind less no motor turns, and no bench has more
NO_VOLTAGE = 50.0  # V: without a unit, more is no voltage of a bench
FOLLOWS = 0.5  # of the speed's differences: a larger misfit tells no time constant
NEARLY = 0.9  # of the largest sample: what is called the largest
DECIMAL = 0.01  # of a digit: a quantum of 1, 2 or 5 × 10ⁿ is the print's
RAW = frozenset({"raw", "adc"})  # words of a heading
LINES, WHOLE = (16, 20_000), 0.02  # of an encoder a turn; of a count
SIZES = {  # of the largest sample, of a watch's motor or a turn in two hours to a locomotive's or a dentist's turbine
    "v": (5e-4, 1e5, "voltage", "V"),
    "i": (2e-5, 1e5, "current", "A"),
    "w": (1e-3, 1e5, "speed", "rad/s"),
}
_PER_TURN = {"rpm": 60.0, "deg/s": 360.0, "rev/s": 1.0}


def size(m: MeasuredSignals, name: str) -> Finding | None:
    """Find a signal of which no motor has the size, whoever says its unit: nothing that is fitted to it is a number."""
    if name not in m.signals:
        return None
    least, most, title, unit = SIZES[name]
    y = np.abs(m.signals[name])
    largest = float(np.nanmax(y))
    if largest == 0 or least <= largest <= most:
        return None
    return Finding(
        f"unit {name}",
        f"{m.title}: the {title} goes up to {largest:.4g} {unit}, as no motor's does: say its true unit with --unit"
        f" {name}=UNIT, or give a factor with --scale {name}=FACTOR",
        is_fatal=True,
        is_sure=True,
        evidence=(m.beyond(name, y, NEARLY * largest),),
    )


def voltage_unit(m: MeasuredSignals) -> Finding | None:
    """Find a duty cycle that was read as volts, and volts as millivolts, or the reverse."""
    if "v" not in m.signals:
        return None
    v = np.abs(m.signals["v"])
    largest = float(np.nanmax(v))
    if largest == 0:
        return None
    if "v" in m.small_units and largest < VOLTS[0]:
        return Finding(
            "unit v",
            f"{m.title}: the voltage stays below {1e3 * largest:.3g} mV while the motor moves: it looks like V"
            " that were read as mV; say so with --unit v=V, or --unit v=mV if not",
            evidence=(m.beyond("v", v, NEARLY * largest),),
        )
    if "v" not in m.guessed and largest > VOLTS[1] and largest not in DUTY:
        return Finding(
            "unit v",
            f"{m.title}: the voltage goes up to {largest:.4g} V: it looks like mV; say so with --unit v=mV, or"
            " --unit v=V if not",
            evidence=(m.beyond("v", v, NEARLY * largest),),
        )
    assumed = "v" in m.guessed
    duty = next((full for full in DUTY if 0.995 * full < largest <= full), None)
    fastest = FULL_PER_VOLT if duty == 1.0 else FASTEST_PER_VOLT[0]
    sizes, counts = np.unique(v[v > DRIVEN * largest], return_counts=True)
    is_full = largest in DUTY and int(counts[-1]) >= HELD  # exactly so, and held: the end of a scale
    if is_full and largest == 1.0 and np.count_nonzero(counts >= HELD) >= LEVELS:
        fastest = STEPPED_PER_VOLT
    part = largest <= 1.0 and (assumed or _speed_per_volt(m) > fastest)
    counted = is_full and largest >= 100.0  # whoever calls it volts: a bench's end nowhere else so exactly
    if part or counted or (assumed and (largest > NO_VOLTAGE or (duty is not None and duty >= 100.0))):
        full = 1.0 if part else next((f for f in DUTY[1:] if largest <= f), DUTY[-1])
        unit = {1.0: "parts of the supply (0 to 1)", 100.0: "percent"}.get(full, f"counts of {full:g}")
        way = "VOLTS" if full == 1 else f"VOLTS/{full:g}"
        remedy = f"give the supply's volts as a factor, --scale v={way}, or --unit v=V if they are volts"
        if largest >= LEAST_MILLIVOLTS and largest not in DUTY:
            unit, remedy = f"{unit}, or like mV", f"{remedy}, v=mV if millivolts"
        return Finding(
            "unit v",
            f"{m.title}: the voltage goes up to {largest:.4g} V: it looks like a duty cycle, in {unit}; {remedy}",
            evidence=(m.beyond("v", v, NEARLY * largest),),
        )
    return None


def speed_unit(m: MeasuredSignals, *, is_volts: bool) -> Finding | None:
    """Find rpm or degrees that were read as radians; of what is no voltage the speed for a volt says nothing."""
    if "w" not in m.signals:
        return None
    w = m.signals["w"]
    assumed = "w" in m.guessed
    top = float(np.nanmax(np.abs(_without_outliers(w))))
    per_volt = _speed_per_volt(m) if is_volts else 0.0
    turning = (m.beyond("w", np.abs(w), NEARLY * top),)
    if (unit := _beside_angle(m, w)) is not None:
        return Finding(
            "unit w",
            f"{m.title}: held against the angle, the speed is {unit}, not rad/s; say so with --unit w={unit}",
            evidence=turning,
        )
    if (unit := _counted(m, w)) is not None:
        return Finding(
            "unit w",
            f"{m.title}: the speed moves in steps of {quantum(w):.6g} rad/s, which is no encoder's in rad/s but"
            f" one's of {_PER_TURN[unit] / quantum(w) / median(np.diff(m.time)):.6g} counts a turn in"
            f" {unit}: it looks like {unit}; say so with --unit w={unit}, or --unit w=rad/s if it is not",
            evidence=turning,
        )
    per_limit = FASTEST_PER_VOLT[assumed]
    if top <= FASTEST[assumed] and per_volt <= per_limit:
        return None
    reading = f"{top:.4g} rad/s, which is {top * 30 / np.pi:.3g} rpm"
    reading += f", {per_volt:.3g} rad/s a volt" if per_volt > per_limit else ""
    units = ["rpm"] if top < DEGREES else ["rpm", "deg/s"] if top < NO_RPM else ["deg/s"]
    said = " or ".join(f"--unit w={unit}" for unit in units)
    return Finding(
        "unit w",
        f"{m.title}: the speed goes up to {reading}: it looks like {' or '.join(units)}; say so with {said}, or"
        " --unit w=rad/s if it is not",
        evidence=turning,
    )


def current_unit(m: MeasuredSignals, *, is_volts: bool) -> Finding | None:
    """Find milliamperes that were read as amperes, and the reverse."""
    if "i" not in m.signals:
        return None
    i = np.abs(_without_outliers(m.signals["i"]))
    largest = float(np.nanmax(i))
    shown = m.signals["i"][np.isfinite(m.signals["i"])]
    narrow = "i" in m.guessed or np.array_equal(shown, np.rint(shown))  # whole amperes no sensor shows
    largest_at = (m.beyond("i", np.abs(m.signals["i"]), NEARLY * largest),)
    volts = float(np.nanmax(np.abs(m.signals["v"]))) if "v" in m.signals else 0.0
    if largest > LARGEST_CURRENT[narrow] and volts < LEAST_RESISTANCE[narrow] * largest:
        return Finding(
            "unit i",
            f"{m.title}: the current goes up to {largest:.4g} A at {volts:.3g} V, a winding of"
            f" {1000 * volts / largest:.2g} mΩ: it looks like mA; say so with --unit i=mA, or --unit i=A if not",
            evidence=largest_at,
        )
    if 0 < largest < LEAST_CURRENT and "w" in m.signals:
        return Finding(
            "unit i",
            f"{m.title}: the current stays below {1e6 * largest:.3g} µA while the motor turns: it looks like A"
            " that were read as mA; say so with --unit i=A",
            evidence=largest_at,
        )
    rising = largest > RISING * median(i[-max(5, len(i) // 10) :])
    if "i" in m.small_units and is_volts and volts > MOST_RESISTANCE[rising] * largest > 0:
        return Finding(
            "unit i",
            f"{m.title}: the current stays below {1e3 * largest:.3g} mA at {volts:.3g} V, a winding of"
            f" {volts / largest / 1e3:.2g} kΩ: it looks like A that were read as mA; say so with --unit i=A, or"
            " --unit i=mA if not",
            evidence=largest_at,
        )
    return None


def clock_unit(m: MeasuredSignals) -> Finding | None:
    """Find milliseconds, microseconds or nanoseconds that were read as seconds, and the reverse.

    Of a step of many seconds, or a motor that takes an hour, no simulation comes to its end; of one of nanoseconds a
    motor's response is too short to be told in numbers of double precision.
    """
    step = median(np.diff(m.time))
    assumed = "time" in m.guessed
    constant = _time_constant(m)
    peak = _time_to_peak(m)
    if step < SHORTEST_CLOCK:
        return Finding(
            "unit time",
            f"{m.title}: its samples are {step:.4g} s apart ({1 / step:.4g} Hz), too near for any motor to answer"
            " between them: give the times in their true unit with --unit time=UNIT",
            is_fatal=True,
            is_sure=True,
        )
    if step < LEAST_CLOCK:
        return Finding(
            "unit time",
            f"{m.title}: its samples are {step:.4g} s apart ({1 / step:.4g} Hz), as no motor's are: the unit of the"
            " time looks too small; say it with --unit time=s, or say the unit again if it is right",
            is_fatal=True,
        )
    if 0 < constant < QUICKEST:
        return Finding(
            "unit time",
            f"{m.title}: at a sampling interval of {step:.4g} s the speed follows with a time constant of"
            f" {constant:.3g} s, which is no motor's: the unit of the time looks too small; say so with"
            " --unit time=s, or say the unit again if it is right",
            evidence=m.response("w"),
        )
    slow = constant > SLOWEST[assumed] or (step > SLOW_CLOCK[assumed] and constant > 2 * step)
    if not (slow or peak > SLOW_CURRENT or step > NO_CLOCK[assumed]):
        return None
    moves = tuple(name for name in ("i", "w") if name in m.signals) if "v" in m.signals else ()
    odd = max(step / US_CLOCK, constant / US_CONSTANT)
    unit = "ms" if odd <= 1 else "us" if odd <= 1000 else "ns"
    lags = [f"the speed follows with a time constant of {constant:.3g} s"] if constant > 0 else []
    lags += [f"the current takes {peak:.3g} s to its peak"] if peak > SLOW_CURRENT else []
    seen = f" {' and '.join(lags)}" if lags else ""
    return Finding(
        "unit time",
        f"{m.title}: at a sampling interval of {step:.4g} s{seen}: the time looks like {unit}; say so with"
        f" --unit time={unit}, or --unit time=s if it is not",
        is_fatal=odd > 1,
        evidence=m.response(*moves),
    )


def converter_counts(m: MeasuredSignals) -> list[Finding]:
    """Find a converter's counts: whole numbers under a heading that says they are raw, and no unit."""
    found = []
    for name, title in (("i", "current"), ("w", "speed")):
        header = m.columns.get(name, "")
        words = frozenset(plain(parse_header(header).name).split("_"))
        if name not in m.guessed or not words & RAW or name not in m.signals:
            continue
        y = m.signals[name]
        if quantum(y) < 1.0:
            continue
        found.append(
            Finding(
                f"unit {name}",
                f"{m.title}: {header!r} has whole numbers and no unit, so they look like counts of a converter"
                f" that shows the {title}, {y[0]:.4g} in the first row: say what one is worth with --scale"
                f" {name}=FACTOR and --offset {name}=NUMBER, which is added behind it, or --unit {name}="
                f"{'mA' if name == 'i' else 'rpm'} if they are none",
                is_fatal=True,
                evidence=(m.evidence(name),),
            )
        )
    return found


def _speed_per_volt(m: MeasuredSignals) -> float:
    """Return the largest speed over the largest voltage, rad/s/V."""
    if not {"v", "w"} <= m.signals.keys():
        return 0.0
    volts = float(np.nanmax(np.abs(m.signals["v"])))
    return float(np.nanmax(np.abs(_without_outliers(m.signals["w"])))) / volts if volts > 0 else 0.0


def _beside_angle(m: MeasuredSignals, w: FloatArray) -> str | None:
    """Return the unit in which a speed is, as the angle that was logged beside it says; None: as it was read."""
    if "angle" not in m.signals:
        return None
    angle = m.signals["angle"]
    whole = ~np.isnan(angle) & ~np.isnan(w)
    turned, t = angle[whole], m.time[whole]
    if len(turned) < 20 or np.max(np.abs(np.diff(turned))) > np.pi:
        return None  # it begins again with every turn
    way = float(np.sum(np.abs(np.diff(turned))))
    shown = float(np.sum(np.abs(w[whole][1:]) * np.diff(t)))
    if way < 20 * quantum(turned) or shown == 0:
        return None
    ratio = shown / way
    for unit, per_turn in _PER_TURN.items():
        if abs(ratio / (per_turn / (2 * np.pi)) - 1) < 0.05:
            return unit
    return None


def _counted(m: MeasuredSignals, w: FloatArray) -> str | None:
    """Return the unit in which a speed's steps are an encoder's whole lines, where they are none in rad/s."""
    step = quantum(w) * median(np.diff(m.time))
    if step <= 0 or _is_decimal(quantum(w)) or "w" not in m.guessed or _is_lines(2 * np.pi / step):
        return None
    return next((unit for unit, per_turn in _PER_TURN.items() if _is_lines(per_turn / step)), None)


def _time_constant(m: MeasuredSignals) -> float:
    """Return the time constant of the speed behind the voltage, s; 0 where none shows."""
    if not {"v", "w"} <= m.signals.keys() or np.isnan(m.signals["v"]).any() or np.ptp(m.signals["v"]) == 0:
        return 0.0
    v, w = m.signals["v"], filled(m.signals["w"])
    best = 0.0
    for every in {1, max(1, len(w) // 400)}:  # coarser samples: less noise in their differences
        now, drive = w[::every], v[::every][:-1]
        rows = np.column_stack([now[:-1], drive, np.ones(len(now) - 1)])
        solution, *_ = np.linalg.lstsq(rows, now[1:], rcond=None)
        pole = float(solution[0])
        if not 0.2 < pole < 0.9999 or np.std(now[1:] - rows @ solution) > FOLLOWS * np.std(np.diff(now)):
            continue
        best = max(best, -every * median(np.diff(m.time)) / float(np.log(pole)))
    return best


def _time_to_peak(m: MeasuredSignals) -> float:
    """Return the time from the first step of the voltage to the current's peak, s; 0 where none shows."""
    if not {"v", "i"} <= m.signals.keys():
        return 0.0
    v, i = m.signals["v"], filled(m.signals["i"])
    changes = np.flatnonzero(np.abs(np.diff(v)) > 0.5 * np.ptp(v))
    if len(changes) != 1 or np.ptp(v) == 0:
        return 0.0
    k = int(changes[0]) + 1
    later = k + np.flatnonzero(np.abs(np.diff(v[k:])) > 0.05 * np.ptp(v)) + 1  # another level has its own peak
    i = i[: int(later[0]) if len(later) else len(i)]
    if len(i) <= k:
        return 0.0
    peak = k + int(np.argmax(np.abs(i[k:])))
    final = median(np.abs(i[-max(5, (len(i) - k) // 10) :]))
    if peak - k < 3 or abs(i[peak]) < 1.5 * final + 6 * noise_deviation(i):
        return 0.0
    return float(m.time[peak] - m.time[k])


def _without_outliers(y: FloatArray) -> FloatArray:
    """Return the samples that two neighbours share: the smallest of three by size, (n − 2,)."""
    y = y[~np.isnan(y)]
    if len(y) < 5:
        return y
    before, now, after = y[:-2], y[1:-1], y[2:]
    return np.asarray(np.maximum(np.minimum(before, now), np.minimum(np.maximum(before, now), after)))


def _is_decimal(step: float) -> bool:
    """Return whether a quantum is 1, 2 or 5 × 10ⁿ: the print's, no encoder's."""
    leading = step / 10 ** np.floor(np.log10(step))
    return bool(np.min(np.abs(np.array([1.0, 2.0, 2.5, 5.0, 10.0]) - leading)) < DECIMAL)


def _is_lines(count: float) -> bool:
    """Return whether a number of counts a turn is an encoder's: whole, and divisible by four."""
    return LINES[0] <= count <= LINES[1] and abs(count - 4 * round(count / 4)) < WHOLE
