"""An angle that was read as radians and is in degrees or counts. Knows one recording's signals, no speed and no FMU."""

from __future__ import annotations

import shlex

import numpy as np

from estimator.recordings.finding import Finding
from estimator.recordings.measured_signals import MeasuredSignals

TURN, NEARLY = 360.0, 0.8  # degrees; of a turn: an angle that jumps by so much starts again
WIDEST = 1.01 * TURN  # an angle that starts again with every turn spans no more
LEVELS = 20  # whole numbers: fewer may be a turn counter's


def angle_unit(m: MeasuredSignals) -> Finding | None:
    """Find degrees, or an encoder's counts, in an angle of which nobody said the unit."""
    if "angle" not in m.signals or "angle" not in m.guessed:
        return None
    angle = m.signals["angle"]
    known = angle[~np.isnan(angle)]
    jump, span = float(np.max(np.abs(np.diff(known)), initial=0.0)), float(np.ptp(known))
    if jump > NEARLY * TURN and span <= WIDEST:
        return Finding(
            "unit angle",
            f"{m.title}: the angle starts again at {TURN:g}: it looks like deg; say so with --unit angle=deg, or"
            " --unit angle=rad if it is not",
            evidence=(m.evidence("angle"),),
        )
    if span >= LEVELS and len(np.unique(known)) >= LEVELS and np.array_equal(known, np.round(known)):
        column = shlex.quote(f"angle={m.columns.get('angle', 'angle')}")
        return Finding(
            "unit angle",
            f"{m.title}: the angle is shown in whole numbers, as no radians are: it looks like deg, or like counts of"
            f" an encoder; say so with --unit angle=deg, or with --column {column} --counts N, of N a turn, or"
            " --unit angle=rad if it is rad",
            evidence=(m.evidence("angle"),),
        )
    return None
