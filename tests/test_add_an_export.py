"""The pages on how to add an export and a model: their C is compiled, and has the values that it should have."""

import re
import subprocess
from pathlib import Path

import numpy as np
from made_estimates import MOTOR, estimate, with_parameter

import fmu_build
from estimator.fmus.simulate import simulate
from fmu_build.compiler import find_compiler

DOCS = Path(__file__).parent.parent / "docs"


def code_of(page, language):
    (code,) = re.findall(rf"```{language}\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.S)
    return code


def test_the_header_of_the_page_compiles_and_keeps_every_bit(tmp_path):
    names = {}
    exec(compile(code_of("add-an-export.md", "python"), "page", "exec"), names)
    made = with_parameter(estimate(), "R", value=1 / 3)
    (tmp_path / "motor.h").write_bytes(names["c_header"](made))
    prints = "".join(f'printf("%.17g\\n", MOTOR_{n});' for n in MOTOR)
    main = f'#include <stdio.h>\n#include "motor.h"\nint main(void) {{ {prints} return 0; }}\n'
    (tmp_path / "main.c").write_text(main)
    subprocess.run([*find_compiler(), "main.c", "-o", "main"], cwd=tmp_path, check=True)
    shown = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout.split()
    assert [float(x) for x in shown] == [{**MOTOR, "R": 1 / 3}[n] for n in MOTOR]
    assert "standard error" in (tmp_path / "motor.h").read_text()


def test_the_model_of_the_page_builds_and_agrees_with_its_closed_form(tmp_path):
    (tmp_path / "winding.c").write_text(code_of("own-model.md", "c"))
    fmu = fmu_build.build(tmp_path / "winding.c", output=tmp_path / "winding.fmu")
    times = np.arange(0.0, 0.05, 1e-3)
    shown = simulate(str(fmu), parameters={"R": 2.0}, inputs={"v": np.full(len(times), 10.0)}, times=times)
    current = 5.0 * -np.expm1(-times * 2.0 / 0.01)
    np.testing.assert_allclose(shown["i"], current, atol=1e-12)
    np.testing.assert_allclose(shown["heat"][1:], 2.0 * current[1:] ** 2, rtol=1e-10)
