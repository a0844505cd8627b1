"""What the DC motor's parameters, inputs and states are called, everywhere. Knows no equation."""

from __future__ import annotations

from collections.abc import Collection, Mapping

MOTOR = ("R", "K", "L", "J", "B")
# Parts by which they change from run to run of a motor: contacts and a winding that warms, magnets, bearings. An
# inductance and a rotor's inertia do not: what seems to change them is not explained.
CHANGES: Mapping[str, float] = {"R": 0.2, "K": 0.05, "B": 0.5}
ALIKE = 0.005  # of what does not change: by as little a model of a motor may miss it, and its bar holds that
BUNDLED = ("dc_motor", "dc_motor_friction", "dc_motor_drive")  # FMUs; the last has all names of the others, and more
INPUTS, STATES = ("v", "load"), ("i", "w")


def has_motor(names: Collection[str]) -> bool:
    """Return whether all five parameters of a DC motor are among these names."""
    return set(MOTOR) <= set(names)


def is_motor(values: Mapping[str, float]) -> bool:
    """Return whether these are a DC motor's parameters: R, K, L, J and B by name, with a winding and an inertia."""
    return has_motor(values) and values["L"] > 0 and values["J"] > 0
