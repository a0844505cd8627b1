"""The effects that are known, in one table. FMU_ESTIMATOR_WITHOUT=NAME leaves one out, to test the verdict."""

from __future__ import annotations

import os

from estimator.fitting.effects.average import Average, MeanSpeed
from estimator.fitting.effects.base import SELDOM, Effect
from estimator.fitting.effects.channel_delay import ChannelDelay
from estimator.fitting.effects.delay import Delay
from estimator.fitting.effects.drive import (
    BreakAway,
    BrushDrop,
    Coasting,
    CurrentLimit,
    DeadBand,
    DryFriction,
    Sag,
    StribeckFriction,
)
from estimator.fitting.effects.drive_drop import DriveDrop
from estimator.fitting.effects.edge_latency import EdgeLatency
from estimator.fitting.effects.gain import Gain
from estimator.fitting.effects.lost_rows import LostRows
from estimator.fitting.effects.low_pass import FORMS, LowPass
from estimator.fitting.effects.machine_effects import FrictionDrift, WindingWarms
from estimator.fitting.effects.offset import Offset
from estimator.fitting.effects.ripple import Ripple
from estimator.fitting.effects.ripple_of_few_turns import Commutation, Eccentricity
from estimator.fitting.effects.runs_differ import RunsDiffer
from estimator.fitting.effects.starting_motion import StartingMotion
from estimator.fitting.effects.switching_ripple import SwitchingRipple
from estimator.fitting.effects.voltage_noise import VoltageNoise
from estimator.fitting.effects.voltage_transient import VoltageTransient

EFFECTS: tuple[Effect, ...] = (
    Delay(),
    ChannelDelay(),
    *(LowPass(name=form, lateness=lateness) for form, (_, lateness, _) in FORMS.items()),
    Average(),
    MeanSpeed(),
    Offset(),
    Gain(),
    Ripple(),
    SwitchingRipple(),
    Eccentricity(),
    Commutation(),
    FrictionDrift(),
    WindingWarms(),
    EdgeLatency(),
    DryFriction(),
    BreakAway(),
    StribeckFriction(),
    BrushDrop(),
    CurrentLimit(),
    Coasting(),
    Sag(),
    DeadBand(),
    DriveDrop(),
    RunsDiffer(),
    StartingMotion(),
    VoltageNoise(),
    VoltageTransient(),
    VoltageTransient(name="voltage overshoot", sign=-1, prior=SELDOM / 1000),  # a supply that sags is as likely
    LostRows(),
)


def known_effects() -> tuple[Effect, ...]:
    """Return the effects, without those that FMU_ESTIMATOR_WITHOUT names, separated by commas."""
    without = {name.strip() for name in os.environ.get("FMU_ESTIMATOR_WITHOUT", "").split(",")}
    return tuple(e for e in EFFECTS if e.name not in without)
