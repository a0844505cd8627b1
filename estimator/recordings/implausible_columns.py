"""Columns of a motor that are another's, of the wrong sign, or hold a logger's errors. Knows no FMU."""

from __future__ import annotations

import shlex

import numpy as np
from numpy.typing import NDArray

from estimator.recordings.finding import Evidence, Finding
from estimator.recordings.lag import lag_misfit
from estimator.recordings.measured_signals import DRIVEN, JUMP, LEAD, MeasuredSignals
from estimator.recordings.samples import quantile
from estimator.recordings.signal_noise import noise_deviation

FloatArray = NDArray[np.float64]

EXPLAINED, UNEXPLAINED = 0.3, 0.7  # of a signal's deviation, misfit of an order that fits, and of one that does not
PLAINLY = 0.2  # of a signal's largest sample: less is noise about zero
AGAINST = 0.3  # of ∫|v y| dt: so much of it negative is a sign
SURE = 4.0  # deviations of noise: more is none
OUTLYING = 0.98  # of the samples: larger ones count as that
LATEST, SHIFTS = 8, 60  # of the rows: the latest that a voltage is thought to reach its motor; of those tried
LONE, ABOVE = 3, 300.0  # samples, times as large as all others: no motor's


def wrong_signs(m: MeasuredSignals) -> list[Finding]:
    """Find signals that go against the voltage: a motor takes power and turns the way that it is driven."""
    if "v" not in m.signals:
        return []
    names = [name for name in ("i", "w") if name in m.signals]
    against = [name for name in names if _is_against(m, name)]
    if len(against) == 2:
        return [
            Finding(
                "sign v",
                f"{m.title}: current and speed both go against the voltage, so the motor would brake all the"
                f" time: check the sign of the voltage; {_turning(m, 'v')}",
                is_fatal=True,
                evidence=tuple(_against(m, name) for name in against),
            )
        ]
    title = {"i": "current", "w": "speed"}
    meaning = {"i": "the motor would give off power all the time", "w": "the motor would turn against its drive"}
    return [
        Finding(
            f"sign {name}",
            f"{m.title}: the {title[name]} goes against the voltage, so {meaning[name]}: check the sign of the"
            f" {title[name]} (or of the voltage); {_turning(m, name)}",
            is_fatal=True,
            evidence=(_against(m, name),),
        )
        for name in against
    ]


def _turning(m: MeasuredSignals, name: str) -> str:
    return f"leave out the factor that turns {name}" if name in m.turned else f"--scale {name}=-1 turns it"


def exchanged_columns(m: MeasuredSignals) -> Finding | None:
    """Find current and speed exchanged: the shaft integrates the torque, J dw/dt = K i − B w, never the reverse.

    Only behind a voltage that jumps: in a ramp both move alike.
    """
    if not {"v", "i", "w"} <= m.signals.keys():
        return None
    v, i, w = (m.signals[name] for name in ("v", "i", "w"))
    if not np.any(np.abs(np.diff(v))[LEAD:] > JUMP * np.ptp(v)):
        return None
    as_read = lag_misfit(m.time, i, w, enough=UNEXPLAINED)
    if as_read <= UNEXPLAINED or (turned := lag_misfit(m.time, w, i)) >= EXPLAINED:
        return None
    return Finding(
        "exchanged",
        f"{m.title}: current and speed look exchanged: what was read as the current follows what was read as"
        f" the speed as a shaft follows its torque (misfit {100 * turned:.1g} % against {100 * as_read:.2g} %);"
        f" exchange their headers, or say {_option(m, 'i', 'w', 'A')} {_option(m, 'w', 'i', 'rad/s')}",
        is_fatal=True,
        evidence=m.response("i", "w"),
    )


def lone_samples(m: MeasuredSignals) -> list[Finding]:
    """Find a few samples so large that nothing but a logger's error makes them."""
    found = []
    for name, title in (("v", "voltage"), ("i", "current"), ("w", "speed")):
        sizes = np.abs(m.signals.get(name, np.zeros(0)))
        known = sizes[~np.isnan(sizes)]
        if len(known) <= LONE:
            continue
        largest = np.partition(known, (-LONE - 1, -1))[-LONE - 1 :]  # the least of them first
        count = int(np.sum(largest > ABOVE * largest[0]))
        if count and largest[0] > 0:
            k = int(np.nanargmax(sizes))
            at = f"{m.signals[name][k]:.4g} at t = {m.time[k]:.6g} s"
            what = f", one of {count} samples that are" if count > 1 else ","
            found.append(
                Finding(
                    f"lone {name}",
                    f"{m.title}: the {title} is {at}{what} more than {ABOVE:g} times as large as all others: an"
                    " error of the logger; leave such a cell empty",
                    is_fatal=True,  # it would be what the search fits
                    evidence=(m.beyond(name, sizes, ABOVE * float(largest[0])),),
                )
            )
    return found


def _option(m: MeasuredSignals, signal: str, other: str, unit: str) -> str:
    """Return the options by which a signal is another's column."""
    return f"--column {shlex.quote(f'{signal}={m.columns.get(other, other)}')} --unit {signal}={unit}"


def _is_against(m: MeasuredSignals, name: str) -> bool:
    v, y = m.signals["v"], m.signals[name]
    driven = (np.abs(v) > DRIVEN * np.nanmax(np.abs(v))) & ~np.isnan(y)
    if not driven.any():
        return False
    most, noise = quantile(np.abs(y), OUTLYING), noise_deviation(y)
    power = v * np.clip(y, -most, most)
    if np.sum(power[driven]) > -SURE * noise * np.linalg.norm(v[driven]):
        return False  # a few samples of a fast oscillation are none
    power = power[driven & (np.abs(y) > SURE * noise)]
    whole = float(np.sum(np.abs(power)))
    if not (whole > 0 and float(np.sum(power)) < -AGAINST * whole):
        return False
    return not _follows_late(v, np.nan_to_num(np.clip(y, -most, most)), -float(np.sum(power)) / whole)


def _follows_late(v: FloatArray, y: FloatArray, against: float) -> bool:
    """Whether a signal, (n,), goes with the voltage some rows before more than it goes against it now, a part of 1.

    A voltage that changes its sign all the time, and reaches the motor late, looks as if it were of the wrong sign.
    """
    last = len(v) // LATEST
    for rows in np.unique(np.geomspace(1, max(last, 1), SHIFTS).astype(int)).tolist():
        power = v[:-rows] * y[rows:]
        whole = float(np.sum(np.abs(power)))
        if whole > 0 and float(np.sum(power)) > against * whole:
            return True
    return False


def _against(m: MeasuredSignals, name: str) -> Evidence:
    """Return the samples of a signal that go against the voltage."""
    y = np.nan_to_num(m.signals[name])
    return m.beyond(name, -np.sign(m.signals["v"]) * y, PLAINLY * float(np.max(np.abs(y))))
