"""The paper's bench, emulated: its motor through the bundled FMU, its voltage step, white noise on what is measured.

Knows no estimation. Source: Rodríguez-Abreo et al., IEEE Access 2021, doi 10.1109/ACCESS.2021.3078578, section IV and
Table III; the noise is that of the bench of section V.
"""

from __future__ import annotations

import numpy as np

from estimator.commands.drive import instants, stepped_voltage
from estimator.results.result import FloatArray

MOTOR = "Mavilor CML-050"
NOMINAL = {"R": 3.1363, "K": 0.048774, "L": 0.01307, "J": 9.0e-6, "B": 1.690e-4}  # Ohm, V.s/rad, H, kg.m2, N.m.s/rad
VOLTAGE, STEP_AT, STOP, STEP = 10.5, 0.5, 2.8, 1e-3  # V, s, s, s
NOISE = {"i": 0.02, "w": 1.0}  # A, rad/s; standard deviations
NOISE_SEED = 1


def emulated_recording(*, seed: int = NOISE_SEED) -> dict[str, FloatArray]:
    """Return what the bench would have recorded: column header → samples, shape (2801,), time first."""
    from estimator.fmus.simulate import simulate

    times = instants(stop=STOP, step=STEP)
    voltage = stepped_voltage(times, level=VOLTAGE, at=STEP_AT)
    outputs = simulate("dc_motor", parameters=NOMINAL, inputs={"v": voltage}, times=times)
    rng = np.random.default_rng(seed)
    measured = {name: outputs[name] + sigma * rng.standard_normal(len(times)) for name, sigma in NOISE.items()}
    return {
        "time [s]": times,
        "voltage [V]": voltage,
        "current [A]": measured["i"],
        "speed [rad/s]": measured["w"],
    }
