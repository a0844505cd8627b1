"""The effects that are known, in one table. FMU_ESTIMATOR_WITHOUT=NAME leaves one out, to test the verdict."""

from __future__ import annotations

import os

from estimator.explaining.effects.ac_coupling import AcCoupling
from estimator.explaining.effects.average import Average, MeanSpeed
from estimator.explaining.effects.base import SELDOM, Effect
from estimator.explaining.effects.channel_delay import ChannelDelay
from estimator.explaining.effects.common_mode import CommonMode
from estimator.explaining.effects.delay import Delay
from estimator.explaining.effects.drive import (
    BreakAway,
    BrushDrop,
    Coasting,
    CurrentLimit,
    DeadBand,
    DryFriction,
    Sag,
    StribeckFriction,
)
from estimator.explaining.effects.drive_drop import DriveDrop
from estimator.explaining.effects.edge_latency import EdgeLatency
from estimator.explaining.effects.gain import Gain
from estimator.explaining.effects.gain_by_range import GainByRange
from estimator.explaining.effects.hum import Hum
from estimator.explaining.effects.limit_slope import LimitSlope
from estimator.explaining.effects.load_step import LoadStep
from estimator.explaining.effects.load_torque import LoadTorque
from estimator.explaining.effects.lost_rows import LostRows
from estimator.explaining.effects.low_pass import FORMS, ExponentialFilter, LowPass
from estimator.explaining.effects.machine_effects import FrictionDrift, WindingWarms
from estimator.explaining.effects.of_signals import (
    EddyCurrents,
    FanLoad,
    FieldWeakens,
    RoundedDrop,
    SagOfPulses,
    Saturation,
    SensorCurve,
    TwoGains,
)
from estimator.explaining.effects.offset import Offset
from estimator.explaining.effects.offset_drift import OffsetDrift
from estimator.explaining.effects.one_way import OneWay
from estimator.explaining.effects.ripple import Ripple
from estimator.explaining.effects.ripple_of_few_turns import Commutation, Eccentricity
from estimator.explaining.effects.runs_differ import RunsDiffer
from estimator.explaining.effects.scan import Scan
from estimator.explaining.effects.slew_limit import SlewLimit
from estimator.explaining.effects.slow_pwm import SlowPwm
from estimator.explaining.effects.smoothing import Smoothing
from estimator.explaining.effects.starting_motion import StartingMotion
from estimator.explaining.effects.supply_drift import SupplyDrift
from estimator.explaining.effects.supply_limit import SupplyLimit
from estimator.explaining.effects.supply_ripple import SupplyRipple
from estimator.explaining.effects.switching_ripple import SwitchingRipple
from estimator.explaining.effects.time_mean import TimeMean
from estimator.explaining.effects.unbalance import Unbalance
from estimator.explaining.effects.voltage_noise import VoltageNoise
from estimator.explaining.effects.voltage_offset import VoltageOffset
from estimator.explaining.effects.voltage_ramp import VoltageRamp
from estimator.explaining.effects.voltage_rise import VoltageRise
from estimator.explaining.effects.voltage_sensor import VoltageSensorLag
from estimator.explaining.effects.voltage_transient import VoltageTransient
from estimator.explaining.effects.voltage_within_rows import VoltageWithinRows

EFFECTS: tuple[Effect, ...] = (
    Delay(),
    ChannelDelay(),
    Scan(),
    *(LowPass(name=form, lateness=lateness) for form, (_, lateness, _) in FORMS.items()),
    ExponentialFilter(),
    Smoothing(),
    Average(),
    MeanSpeed(),
    TimeMean(),
    Offset(),
    OffsetDrift(),
    AcCoupling(),
    Gain(),
    TwoGains(),
    GainByRange(),
    SensorCurve(),
    CommonMode(),
    Ripple(),
    SwitchingRipple(),
    SlowPwm(),
    Hum(),
    SupplyRipple(),
    Eccentricity(),
    Commutation(),
    FrictionDrift(),
    WindingWarms(),
    SupplyDrift(),
    LoadTorque(),
    Unbalance(),
    LoadStep(),
    FanLoad(),
    FieldWeakens(),
    Saturation(),
    RoundedDrop(),
    SagOfPulses(),
    EddyCurrents(),
    EdgeLatency(),
    DryFriction(),
    BreakAway(),
    StribeckFriction(),
    BrushDrop(),
    CurrentLimit(),
    LimitSlope(),
    Coasting(),
    OneWay(),
    Sag(),
    DeadBand(),
    DriveDrop(),
    RunsDiffer(),
    StartingMotion(),
    VoltageNoise(),
    VoltageSensorLag(),
    VoltageOffset(),
    VoltageTransient(),
    VoltageTransient(name="voltage overshoot", sign=-1, prior=SELDOM / 1000),  # a supply that sags is as likely
    VoltageRise(),
    VoltageRamp(),
    SlewLimit(),
    SupplyLimit(),
    VoltageWithinRows(),
    LostRows(),
)


def known_effects() -> tuple[Effect, ...]:
    """Return the effects, without those that FMU_ESTIMATOR_WITHOUT names, separated by commas."""
    without = {name.strip() for name in os.environ.get("FMU_ESTIMATOR_WITHOUT", "").split(",")}
    return tuple(e for e in EFFECTS if e.name not in without)
