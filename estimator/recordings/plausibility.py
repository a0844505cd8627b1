"""What of a motor's recording cannot be as it was read: columns exchanged, a sign, a unit. Knows no FMU.

Everything here is found from the samples alone, before any search. Nothing is corrected: what it looks like is named,
with the option that puts it right. Two things no recording can show, because a motor of another size does the same: the
scale of the speed within the range of real motors, and the scale of the current likewise. So a unit is doubted only
where the motor that follows does not exist: limits are those of brushed motors on 3 to 100 V, of bare shafts and with
gears. Where nobody said the unit, the limits are narrower.

How often a detector is wrong on good recordings, and how often it finds what it is for, is in docs/recordings.md.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.excitation import noise_deviation, quantum
from estimator.recordings.finding import Evidence, Finding
from estimator.recordings.headers import parse_header, plain
from estimator.recordings.lag import lag_misfit
from estimator.recordings.odd_drives import coasts, dead_band, is_held
from estimator.recordings.samples import filled, median, quantile
from estimator.recordings.understood import Understood
from estimator.recordings.units import parse_unit

FloatArray = NDArray[np.float64]

# Limits: of units that a header or the user said, and of units that nobody said.
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
QUICKEST = 1e-4  # s, time constant of the speed: the least motors without iron take a millisecond
SLOW_CURRENT = 0.5  # s from a step to the peak of the current; an inductance is over in some 20 ms
DUTY = (1.0, 100.0, 255.0, 1000.0, 1023.0, 4095.0, 65535.0)  # largest values of a duty cycle: part, percent, counts
LEAST_MILLIVOLTS = 1000.0  # a motor turns at that
VOLTS = (0.2, 1000.0)  # behind less no motor turns, and no bench has more
NO_VOLTAGE = 50.0  # V: without a unit, more is no voltage of a bench

EXPLAINED, UNEXPLAINED = 0.3, 0.7  # of a signal's deviation, misfit of an order that fits, and of one that does not
JUMP, LEAD = 0.3, 3  # of the voltage's range, samples before it: a jump
FOLLOWS = 0.5  # of the speed's differences: a larger misfit tells no time constant
PLAINLY = 0.2  # of a signal's largest sample: less is noise about zero
NEARLY = 0.9  # of the largest sample: what is called the largest
SETTLED = 0.1  # of a response: less is its end
AGAINST = 0.3  # of ∫|v y| dt: so much of it negative is a sign
SURE = 4.0  # deviations of noise: more is none
OUTLYING = 0.98  # of the samples: larger ones count as that
DRIVEN = 0.05  # of the largest voltage: less is none
DECIMAL = 0.01  # of a digit: a quantum of 1, 2 or 5 × 10ⁿ is the print's
RAW = frozenset({"raw", "adc"})  # words of a heading
LONE, ABOVE = 3, 300.0  # samples, times as large as all others: no motor's
LINES, WHOLE = (16, 20_000), 0.02  # of an encoder a turn; of a count

_PER_TURN = {"rpm": 60.0, "deg/s": 360.0, "rev/s": 1.0}


def implausible_as_read(
    title: str, time: FloatArray, signals: Mapping[str, FloatArray], read: Sequence[Understood]
) -> tuple[Finding, ...]:
    """Find what of a motor's signals cannot be as it was read, by what is known of how; arguments as `implausible`."""
    return implausible(
        title,
        time,
        signals,
        guessed=frozenset(r.signal for r in read if r.is_guess),
        sure=frozenset(r.signal for r in read if r.unit_from == "user"),
        columns={r.signal: r.column for r in read},
        units={r.signal: r.unit for r in read},
    )


def implausible(
    title: str,
    time: FloatArray,
    signals: Mapping[str, FloatArray],
    *,
    guessed: frozenset[str] = frozenset(),
    sure: frozenset[str] = frozenset(),
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> tuple[Finding, ...]:
    """Find what of a motor's signals cannot be as it was read.

    Parameters
    ----------
    title : str
        What sentences call the recording.
    time : (n,) array, s
    signals : "v", "i", "w", "angle" → (n,) array, SI, NaN where a sample is missing
    guessed : those of them, and "time", whose unit nobody said
    sure : those whose unit the user said again, so that it is not doubted
    columns : signal → header of its column, for the options that are named
    units : signal → unit that its samples were in
    """
    known = {
        name: y for name, y in signals.items() if np.count_nonzero(~np.isnan(y)) > 2 and np.nanmax(y) != np.nanmin(y)
    }
    if not {"i", "w", "angle"} & known.keys():
        return ()
    voltage = {n: y for n, y in signals.items() if n == "v"}
    measured = _Measured(title, time, {**known, **voltage}, guessed, columns or {}, units or {})
    signs = measured.signs()
    exchanged = None if signs else measured.exchanged()
    if exchanged is not None:
        return (exchanged,)  # of columns that are others, nothing else is true
    doubted = measured.voltage()
    found = [
        *signs,
        *measured.lone(),
        *measured.raw(),
        doubted,
        measured.speed(is_volts=doubted is None),
        measured.current(is_volts=doubted is None),
        measured.clock(),
    ]
    found += [
        is_held(title, time, known),
        coasts(title, time, known),
        dead_band(title, time, known),
    ]
    first: dict[str, Finding] = {}  # of what is a converter's counts, no other unit is told
    for f in found:
        if f is not None and f.kind not in {f"unit {name}" for name in sure}:
            first.setdefault(f.kind, f)
    return tuple(first.values())


class _Measured:
    """The signals of one recording, and what is doubted of them."""

    def __init__(
        self,
        title: str,
        time: FloatArray,
        signals: Mapping[str, FloatArray],
        guessed: frozenset[str],
        columns: Mapping[str, str],
        units: Mapping[str, str],
    ) -> None:
        self.title, self.time, self.signals, self.guessed, self.columns = title, time, signals, guessed, columns
        self._small = {n for n, text in units.items() if (unit := parse_unit(text)) and unit.denominator > 1}

    def exchanged(self) -> Finding | None:
        """Find current and speed exchanged: the shaft integrates the torque, J dw/dt = K i − B w, never the reverse.

        Only behind a voltage that jumps: in a ramp both move alike.
        """
        if not {"v", "i", "w"} <= self.signals.keys():
            return None
        v, i, w = (self.signals[name] for name in ("v", "i", "w"))
        if not np.any(np.abs(np.diff(v))[LEAD:] > JUMP * np.ptp(v)):
            return None
        as_read = lag_misfit(self.time, i, w, enough=UNEXPLAINED)
        if as_read <= UNEXPLAINED or (turned := lag_misfit(self.time, w, i)) >= EXPLAINED:
            return None
        return Finding(
            "exchanged",
            f"{self.title}: current and speed look exchanged: what was read as the current follows what was read as"
            f" the speed as a shaft follows its torque (misfit {100 * turned:.1g} % against {100 * as_read:.2g} %);"
            f" exchange their headers, or say {self._option('i', 'w', 'A')} {self._option('w', 'i', 'rad/s')}",
            is_fatal=True,
            evidence=self._response("i", "w"),
        )

    def lone(self) -> list[Finding]:
        """Find a few samples so large that nothing but a logger's error makes them."""
        found = []
        for name, title in (("v", "voltage"), ("i", "current"), ("w", "speed")):
            sizes = np.abs(self.signals.get(name, np.zeros(0)))
            known = sizes[~np.isnan(sizes)]
            if len(known) <= LONE:
                continue
            largest = np.partition(known, (-LONE - 1, -1))[-LONE - 1 :]  # the least of them first
            count = int(np.sum(largest > ABOVE * largest[0]))
            if count and largest[0] > 0:
                k = int(np.nanargmax(sizes))
                at = f"{self.signals[name][k]:.4g} at t = {self.time[k]:.6g} s"
                what = f", one of {count} samples that are" if count > 1 else ","
                found.append(
                    Finding(
                        f"lone {name}",
                        f"{self.title}: the {title} is {at}{what} more than {ABOVE:g} times as large as all others: an"
                        " error of the logger; leave such a cell empty",
                        is_fatal=True,  # it would be what the search fits
                        evidence=(self._beyond(name, sizes, ABOVE * float(largest[0])),),
                    )
                )
        return found

    def raw(self) -> list[Finding]:
        """Find a converter's counts: whole numbers under a heading that says they are raw, and no unit."""
        found = []
        for name, title in (("i", "current"), ("w", "speed")):
            header = self.columns.get(name, "")
            words = frozenset(plain(parse_header(header).name).split("_"))
            if name not in self.guessed or not words & RAW or name not in self.signals:
                continue
            y = self.signals[name]
            if quantum(y) < 1.0:
                continue
            found.append(
                Finding(
                    f"unit {name}",
                    f"{self.title}: {header!r} has whole numbers and no unit, so they look like counts of a converter"
                    f" that shows the {title}, {y[0]:.4g} in the first row: say what one is worth with --scale"
                    f" {name}=FACTOR and --offset {name}=NUMBER, which is added behind it, or --unit {name}="
                    f"{'mA' if name == 'i' else 'rpm'} if they are none",
                    is_fatal=True,
                    evidence=(self._evidence(name),),
                )
            )
        return found

    def _option(self, signal: str, other: str, unit: str) -> str:
        """Return the options by which a signal is another's column."""
        return f"--column {shlex.quote(f'{signal}={self.columns.get(other, other)}')} --unit {signal}={unit}"

    def signs(self) -> list[Finding]:
        """Find signals that go against the voltage: a motor takes power and turns the way that it is driven."""
        if "v" not in self.signals:
            return []
        names = [name for name in ("i", "w") if name in self.signals]
        against = [name for name in names if self._is_against(name)]
        if len(against) == 2:
            return [
                Finding(
                    "sign v",
                    f"{self.title}: current and speed both go against the voltage, so the motor would brake all the"
                    " time: check the sign of the voltage; --scale v=-1 turns it",
                    is_fatal=True,
                    evidence=tuple(self._against(name) for name in against),
                )
            ]
        title = {"i": "current", "w": "speed"}
        meaning = {"i": "the motor would give off power all the time", "w": "the motor would turn against its drive"}
        return [
            Finding(
                f"sign {name}",
                f"{self.title}: the {title[name]} goes against the voltage, so {meaning[name]}: check the sign of the"
                f" {title[name]} (or of the voltage); --scale {name}=-1 turns it",
                is_fatal=True,
                evidence=(self._against(name),),
            )
            for name in against
        ]

    def _is_against(self, name: str) -> bool:
        v, y = self.signals["v"], self.signals[name]
        driven = (np.abs(v) > DRIVEN * np.nanmax(np.abs(v))) & ~np.isnan(y)
        if not driven.any():
            return False
        most, noise = quantile(np.abs(y), OUTLYING), noise_deviation(y)
        power = v * np.clip(y, -most, most)
        if np.sum(power[driven]) > -SURE * noise * np.linalg.norm(v[driven]):
            return False  # a few samples of a fast oscillation are none
        power = power[driven & (np.abs(y) > SURE * noise)]
        whole = float(np.sum(np.abs(power)))
        return whole > 0 and float(np.sum(power)) < -AGAINST * whole

    def _beyond(self, signal: str, y: FloatArray, limit: float) -> Evidence:
        """Return the samples from the first to the last that are no less than a limit."""
        there = np.flatnonzero(np.nan_to_num(y, nan=-np.inf) >= limit)
        return self._evidence(signal, int(there[0]), int(there[-1])) if len(there) else self._evidence(signal)

    def _evidence(self, signal: str, first: int = 0, last: int = -1) -> Evidence:
        return Evidence(signal, float(self.time[first]), float(self.time[last]))

    def _against(self, name: str) -> Evidence:
        """Return the samples of a signal that go against the voltage."""
        y = np.nan_to_num(self.signals[name])
        return self._beyond(name, -np.sign(self.signals["v"]) * y, PLAINLY * float(np.max(np.abs(y))))

    def _response(self, *names: str) -> tuple[Evidence, ...]:
        """Return the samples between the first jump of the voltage and where the last of the signals stays."""
        v = filled(self.signals["v"])
        jumps = np.flatnonzero(np.abs(np.diff(v)) > JUMP * np.ptp(v)) + 1
        if not len(jumps):
            return tuple(self._evidence(name) for name in names)
        first = int(jumps[0])
        beyond = int(next((k for k in jumps if k > first + LEAD), len(v)))
        last = first + LEAD
        for name in names:
            y = filled(self.signals[name])[first:beyond]
            off = np.abs(y - np.median(y[-max(3, len(y) // 10) :]))
            last = max(last, first + int(np.max(np.flatnonzero(off > SETTLED * np.max(off)), initial=0)))
        return tuple(self._evidence(name, first - 1, min(last, len(v) - 1)) for name in names)

    def voltage(self) -> Finding | None:
        """Find a duty cycle that was read as volts, and volts as millivolts, or the reverse."""
        if "v" not in self.signals:
            return None
        v = np.abs(self.signals["v"])
        largest = float(np.nanmax(v))
        if largest == 0:
            return None
        if "v" in self._small and largest < VOLTS[0]:
            return Finding(
                "unit v",
                f"{self.title}: the voltage stays below {1e3 * largest:.3g} mV while the motor moves: it looks like V"
                " that were read as mV; say so with --unit v=V, or --unit v=mV if not",
                evidence=(self._beyond("v", v, NEARLY * largest),),
            )
        if "v" not in self.guessed and largest > VOLTS[1] and largest not in DUTY:
            return Finding(
                "unit v",
                f"{self.title}: the voltage goes up to {largest:.4g} V: it looks like mV; say so with --unit v=mV, or"
                " --unit v=V if not",
                evidence=(self._beyond("v", v, NEARLY * largest),),
            )
        assumed = "v" in self.guessed
        duty = next((full for full in DUTY if 0.995 * full < largest <= full), None)
        fastest = FULL_PER_VOLT if duty == 1.0 else FASTEST_PER_VOLT[0]
        sizes, counts = np.unique(v[v > DRIVEN * largest], return_counts=True)
        is_full = largest in DUTY and int(counts[-1]) >= HELD  # exactly so, and held: the end of a scale
        if is_full and largest == 1.0 and np.count_nonzero(counts >= HELD) >= LEVELS:
            fastest = STEPPED_PER_VOLT
        part = largest <= 1.0 and (assumed or self._speed_per_volt() > fastest)
        counted = is_full and largest >= 100.0  # whoever calls it volts: a bench's end nowhere else so exactly
        if part or counted or (assumed and (largest > NO_VOLTAGE or (duty is not None and duty >= 100.0))):
            full = 1.0 if part else next((f for f in DUTY[1:] if largest <= f), DUTY[-1])
            unit = {1.0: "1 (a part of the supply)", 100.0: "percent"}.get(full, f"counts of {full:g}")
            way = "VOLTS" if full == 1 else f"VOLTS/{full:g}"
            remedy = f"give the supply's volts as a factor, --scale v={way}, or --unit v=V if they are volts"
            if largest >= LEAST_MILLIVOLTS and largest not in DUTY:
                unit, remedy = f"{unit}, or like mV", f"{remedy}, v=mV if millivolts"
            return Finding(
                "unit v",
                f"{self.title}: the voltage goes up to {largest:.4g} V: it looks like a duty cycle, in {unit};"
                f" {remedy}",
                evidence=(self._beyond("v", v, NEARLY * largest),),
            )
        return None

    def speed(self, *, is_volts: bool) -> Finding | None:
        """Find rpm or degrees that were read as radians; of what is no voltage the speed for a volt says nothing."""
        if "w" not in self.signals:
            return None
        w = self.signals["w"]
        assumed = "w" in self.guessed
        top = float(np.nanmax(np.abs(_without_outliers(w))))
        per_volt = self._speed_per_volt() if is_volts else 0.0
        turning = (self._beyond("w", np.abs(w), NEARLY * top),)
        if (unit := self._beside_angle(w)) is not None:
            return Finding(
                "unit w",
                f"{self.title}: held against the angle, the speed is {unit}, not rad/s; say so with --unit w={unit}",
                evidence=turning,
            )
        if (unit := self._counted(w)) is not None:
            return Finding(
                "unit w",
                f"{self.title}: the speed moves in steps of {quantum(w):.6g} rad/s, which is no encoder's in rad/s but"
                f" one's of {_PER_TURN[unit] / quantum(w) / median(np.diff(self.time)):.6g} counts a turn in"
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
            f"{self.title}: the speed goes up to {reading}: it looks like {' or '.join(units)}; say so with {said}, or"
            " --unit w=rad/s if it is not",
            evidence=turning,
        )

    def current(self, *, is_volts: bool) -> Finding | None:
        """Find milliamperes that were read as amperes, and the reverse."""
        if "i" not in self.signals:
            return None
        i = np.abs(_without_outliers(self.signals["i"]))
        largest = float(np.nanmax(i))
        narrow = "i" in self.guessed or quantum(self.signals["i"]) >= 1.0  # whole amperes no sensor shows
        largest_at = (self._beyond("i", np.abs(self.signals["i"]), NEARLY * largest),)
        volts = float(np.nanmax(np.abs(self.signals["v"]))) if "v" in self.signals else 0.0
        if largest > LARGEST_CURRENT[narrow] and volts < LEAST_RESISTANCE[narrow] * largest:
            return Finding(
                "unit i",
                f"{self.title}: the current goes up to {largest:.4g} A at {volts:.3g} V, a winding of"
                f" {1000 * volts / largest:.2g} mΩ: it looks like mA; say so with --unit i=mA, or --unit i=A if not",
                evidence=largest_at,
            )
        if 0 < largest < LEAST_CURRENT and "w" in self.signals:
            return Finding(
                "unit i",
                f"{self.title}: the current stays below {1e6 * largest:.3g} µA while the motor turns: it looks like A"
                " that were read as mA; say so with --unit i=A",
                evidence=largest_at,
            )
        rising = largest > RISING * median(i[-max(5, len(i) // 10) :])
        if "i" in self._small and is_volts and volts > MOST_RESISTANCE[rising] * largest:
            return Finding(
                "unit i",
                f"{self.title}: the current stays below {1e3 * largest:.3g} mA at {volts:.3g} V, a winding of"
                f" {volts / largest / 1e3:.2g} kΩ: it looks like A that were read as mA; say so with --unit i=A, or"
                " --unit i=mA if not",
                evidence=largest_at,
            )
        return None

    def clock(self) -> Finding | None:
        """Find milliseconds, microseconds or nanoseconds that were read as seconds, and the reverse.

        Of a step of many seconds, or a motor that takes an hour, no simulation comes to its end.
        """
        step = median(np.diff(self.time))
        assumed = "time" in self.guessed
        constant = self._time_constant()
        peak = self._time_to_peak()
        if 0 < constant < QUICKEST:
            return Finding(
                "unit time",
                f"{self.title}: at a sampling interval of {step:.4g} s the speed follows with a time constant of"
                f" {constant:.3g} s, which is no motor's: the unit of the time looks too small; say so with"
                " --unit time=s, or say the unit again if it is right",
                evidence=self._response("w"),
            )
        slow = constant > SLOWEST[assumed] or (step > SLOW_CLOCK[assumed] and constant > 2 * step)
        if not (slow or peak > SLOW_CURRENT or step > NO_CLOCK[assumed]):
            return None
        moves = tuple(name for name in ("i", "w") if name in self.signals) if "v" in self.signals else ()
        odd = max(step / US_CLOCK, constant / US_CONSTANT)
        unit = "ms" if odd <= 1 else "us" if odd <= 1000 else "ns"
        lags = [f"the speed follows with a time constant of {constant:.3g} s"] if constant > 0 else []
        lags += [f"the current takes {peak:.3g} s to its peak"] if peak > SLOW_CURRENT else []
        seen = f" {' and '.join(lags)}" if lags else ""
        return Finding(
            "unit time",
            f"{self.title}: at a sampling interval of {step:.4g} s{seen}: the time looks like {unit}; say so with"
            f" --unit time={unit}, or --unit time=s if it is not",
            is_fatal=odd > 1,
            evidence=self._response(*moves),
        )

    def _speed_per_volt(self) -> float:
        """Return the largest speed over the largest voltage, rad/s/V."""
        if not {"v", "w"} <= self.signals.keys():
            return 0.0
        volts = float(np.nanmax(np.abs(self.signals["v"])))
        return float(np.nanmax(np.abs(_without_outliers(self.signals["w"])))) / volts if volts > 0 else 0.0

    def _beside_angle(self, w: FloatArray) -> str | None:
        """Return the unit in which a speed is, as the angle that was logged beside it says; None: as it was read."""
        if "angle" not in self.signals:
            return None
        angle = self.signals["angle"]
        whole = ~np.isnan(angle) & ~np.isnan(w)
        turned, t = angle[whole], self.time[whole]
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

    def _counted(self, w: FloatArray) -> str | None:
        """Return the unit in which a speed's steps are an encoder's whole lines, where they are none in rad/s."""
        step = quantum(w) * median(np.diff(self.time))
        if step <= 0 or _is_decimal(quantum(w)) or "w" not in self.guessed or _is_lines(2 * np.pi / step):
            return None
        return next((unit for unit, per_turn in _PER_TURN.items() if _is_lines(per_turn / step)), None)

    def _time_constant(self) -> float:
        """Return the time constant of the speed behind the voltage, s; 0 where none shows."""
        if not {"v", "w"} <= self.signals.keys() or np.isnan(self.signals["v"]).any() or np.ptp(self.signals["v"]) == 0:
            return 0.0
        v, w = self.signals["v"], filled(self.signals["w"])
        best = 0.0
        for every in {1, max(1, len(w) // 400)}:  # coarser samples: less noise in their differences
            now, drive = w[::every], v[::every][:-1]
            rows = np.column_stack([now[:-1], drive, np.ones(len(now) - 1)])
            solution, *_ = np.linalg.lstsq(rows, now[1:], rcond=None)
            pole = float(solution[0])
            if not 0.2 < pole < 0.9999 or np.std(now[1:] - rows @ solution) > FOLLOWS * np.std(np.diff(now)):
                continue
            best = max(best, -every * median(np.diff(self.time)) / float(np.log(pole)))
        return best

    def _time_to_peak(self) -> float:
        """Return the time from the first step of the voltage to the current's peak, s; 0 where none shows."""
        if not {"v", "i"} <= self.signals.keys():
            return 0.0
        v, i = self.signals["v"], filled(self.signals["i"])
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
        return float(self.time[peak] - self.time[k])


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
