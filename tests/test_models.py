"""Every bundled model: its parameters are found again from a recording, and it is documented."""

from __future__ import annotations

from pathlib import Path

import fmpy
import numpy as np
import pytest

import fmu_build
from estimator.case import read_case
from estimator.commands import csv_bytes
from estimator.drive import instants
from estimator.estimate import estimate
from estimator.simulate import simulate

ROOT = Path(__file__).parent.parent
GEARED = {"R": 2.1, "K": 0.04, "L": 9e-3, "J": 1.4e-5, "B": 1e-4, "stiffness": 3.1, "damping": 2e-3, "J_load": 7e-4}
GEARED |= {"B_load": 2e-3}
PMSM = {"R": 0.43, "Ld": 1.2e-3, "Lq": 1.9e-3, "flux": 0.0121, "J": 6.1e-5, "B": 1.4e-4}
CASES = {
    "dc_motor_geared": (GEARED, {"gear": 4.0}, ("v",), ("i", "w", "w_load")),
    "pmsm_dq": (PMSM, {"poles": 3.0}, ("vd", "vq"), ("id", "iq", "w")),
}


@pytest.mark.parametrize("model", ["dc_motor_geared", pytest.param("pmsm_dq", marks=pytest.mark.full)])
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


@pytest.mark.parametrize("model", fmu_build.bundled_names())
def test_model_has_a_page_with_every_variable(model: str) -> None:
    page = (ROOT / "docs" / "models" / f"{model}.md").read_text()
    assert page.startswith(f"# {model}\n")
    for variable in fmpy.read_model_description(str(fmu_build.bundled(model))).modelVariables:
        if variable.causality != "local":
            assert f"| `{variable.name}` |" in page
