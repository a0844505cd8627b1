"""Every bundled model: its parameters are found again from a recording, and it is documented."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest

import fmu_build
from estimator.cases.case import Case, read_case
from estimator.commands.csv_text import csv_bytes
from estimator.commands.drive import instants
from estimator.estimating.estimate import estimate
from estimator.fmus.simulate import simulate

pytestmark = pytest.mark.usefixtures("shared_workers")

ROOT = Path(__file__).parent.parent
GEARED = {"R": 2.1, "K": 0.04, "L": 9e-3, "J": 1.4e-5, "B": 1e-4, "stiffness": 3.1, "damping": 2e-3, "J_load": 7e-4}
GEARED |= {"B_load": 2e-3}
PMSM = {"R": 0.43, "Ld": 1.2e-3, "Lq": 1.9e-3, "flux": 0.0121, "J": 6.1e-5, "B": 1.4e-4}
DRY = {"R": 2.6, "K": 0.041, "L": 6e-3, "J": 1.3e-5, "B": 4e-5, "friction": 0.012}
DRIVEN = DRY | {"current_limit": 1.2, "supply_resistance": 0.7, "supply_time": 0.015}
CASES = {
    "dc_motor_drive": (DRIVEN, {"stiction": 0.0, "brush": 0.0, "dead_band": 0.0, "coasts": 0.0}, ("v",), ("i", "w")),
    "dc_motor_geared": (GEARED, {"gear": 4.0}, ("v",), ("i", "w", "w_load")),
    "pmsm_dq": (PMSM, {"poles": 3.0}, ("vd", "vq"), ("id", "iq", "w")),
    "dc_motor_friction": (DRY, {"stiction": 0.0, "brush": 0.0}, ("v",), ("i", "w")),
}


@pytest.mark.parametrize(
    "model", ["dc_motor_drive", "dc_motor_geared", "dc_motor_friction", pytest.param("pmsm_dq", marks=pytest.mark.full)]
)
def test_parameters_are_found_again_from_a_recording(tmp_path: Path, model: str) -> None:
    truth, fixed, inputs, outputs = CASES[model]
    times = instants(stop=0.4, step=1e-3)
    rng = np.random.default_rng(5)
    held = {name: np.repeat(rng.uniform(-8, 8, 41), 10)[: len(times)] for name in inputs}
    shown = simulate(model, parameters=truth | fixed, inputs=held, times=times)
    columns = {"time [s]": times} | {name: held[name] for name in inputs} | {name: shown[name] for name in outputs}
    (tmp_path / "run.csv").write_bytes(csv_bytes(columns))
    case = tmp_path / "run.case.toml"
    lines = [f'[fmu]\npath = "{model}"', "[inputs]", *(f'{name} = "{name}"' for name in inputs)]
    lines += ["[outputs]", *(f'{name} = "{name}"' for name in outputs), "[parameters]"]
    lines += [f"{name} = {{ min = {value / 2!r}, max = {value * 2!r} }}" for name, value in truth.items()]
    lines += ["[fixed]", *(f"{name} = {value}" for name, value in fixed.items()), "load = 0.0"]
    lines += ["[[recording]]", 'file = "run.csv"']
    case.write_text("\n".join(lines))
    found = estimate(read_case(case), workers=1)
    assert found.verdict == "ok", found.reasons
    for name, value in truth.items():
        assert found.parameters[name].value == pytest.approx(value, rel=1e-6), name


def dry_motor(folder: Path, levels: list[float], *, seed: int) -> Case:
    """Return the case of a motor with dry friction, recorded with noise at these voltages, half a second each."""
    times = instants(stop=0.5 * len(levels), step=1e-3)
    v = np.array(levels)[np.minimum((times / 0.5 + 1e-9).astype(int), len(levels) - 1)]
    shown = simulate("dc_motor_friction", parameters=DRY, inputs={"v": v}, times=times)
    noise = np.random.default_rng(seed).standard_normal((2, len(times)))
    columns = {"time [s]": times, "voltage [V]": v}
    columns |= {"current [A]": shown["i"] + 0.02 * noise[0], "speed [rad/s]": shown["w"] + noise[1]}
    (folder / "run.csv").write_bytes(csv_bytes(columns))
    lines = ['[fmu]\npath = "dc_motor_friction"', "[parameters]"]
    lines += [f"{name} = {{ min = {value / 10!r}, max = {value * 10!r} }}" for name, value in DRY.items()]
    lines += ["[fixed]", "stiction = 0.0", "brush = 0.0", "load = 0.0", "[[recording]]", 'file = "run.csv"']
    case = folder / "run.case.toml"
    case.write_text("\n".join(lines))
    return read_case(case)


SEEDS = [1, 2, *(pytest.param(seed, marks=pytest.mark.full) for seed in range(3, 101))]


@pytest.mark.parametrize("seed", SEEDS)
def test_two_voltages_tell_coulomb_friction_from_viscous(tmp_path: Path, seed: int) -> None:
    found = estimate(dry_motor(tmp_path, [0.0, 10.5, 5.0], seed=seed), workers=1)
    assert found.verdict == "ok", found.reasons
    # One of these hundred recordings leaves open a torque that wanders by 2 % of the friction: B's bar holds it.
    leaves_open = seed == 19
    for name, value in DRY.items():
        p = found.parameters[name]
        assert leaves_open or (p.status == "ok" and p.standard_error < 0.03 * value)  # friction may wander by 1 %
        assert abs(p.value - value) < 6 * p.standard_error, name  # 600 of them: 1e-6 by chance


@pytest.mark.parametrize("seed", SEEDS)
def test_one_voltage_does_not_and_the_result_says_so(tmp_path: Path, seed: int) -> None:
    found = estimate(dry_motor(tmp_path, [0.0, 10.5], seed=seed), workers=1)
    told = [found.parameters[name] for name in ("B", "friction")]
    largest = max(p.standard_error / p.value for p in told)
    assert found.verdict == "doubtful" or largest < 0.25, found.reasons  # the transient tells a little
    assert found.verdict == "ok" or any("friction stand in for each other" in r for r in found.reasons)
    for name, value in DRY.items():
        p = found.parameters[name]
        assert abs(p.value - value) < 6 * p.standard_error, name
        assert p.standard_error > 0.1 * p.value or name not in ("B", "friction"), name


@pytest.mark.parametrize("model", fmu_build.bundled_names())
def test_model_has_a_page_with_every_variable(model: str) -> None:
    page = (ROOT / "docs" / "models" / f"{model}.md").read_text()
    assert page.startswith(f"# {model}\n")
    for variable in fmpy.read_model_description(str(fmu_build.bundled(model))).modelVariables:
        if variable.causality != "local":
            assert f"| `{variable.name}` |" in page
