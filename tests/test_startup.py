"""Commands import what they need and no more: what is imported is what start-up costs."""

import subprocess
import sys
from pathlib import Path

import pytest

from estimator.fmus.archive import extract
from estimator.fmus.fmu import describe

ROOT = Path(__file__).resolve().parent.parent
RECORDING = ROOT / "examples" / "cml050_step.csv"

SCRIPT = """
import contextlib, io, sys
from estimator.cli import main
with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
    main({arguments!r})
print(*sorted(name for name in sys.modules if name in {heavy!r}))
"""

HEAVY = ("numpy", "scipy", "scipy.optimize", "scipy.signal", "matplotlib", "fmpy", "lxml")


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        (["--help"], set()),
        (["--version"], set()),
        (["estimate", "--help"], set()),
        (["inspect", "--static", "dc_motor"], {"numpy", "fmpy", "lxml"}),
        (["estimate", str(RECORDING), "--quiet"], {"numpy", "fmpy", "lxml"}),
    ],
    ids=lambda value: " ".join(value[:2]) if isinstance(value, list) else "",
)
def test_a_command_imports_only_what_it_needs(arguments, allowed):
    script = SCRIPT.format(arguments=arguments, heavy=HEAVY)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert set(run.stdout.split()) <= allowed


def test_an_estimate_whose_transient_few_samples_show_loads_nothing_of_scipy(tmp_path):
    header, *rows = (line for line in RECORDING.read_text().splitlines() if not line.startswith("#"))
    few = tmp_path / "few.csv"
    few.write_text("\n".join([header, *rows[::7]]) + "\n")
    script = SCRIPT.format(arguments=["estimate", str(few), "--quiet"], heavy=HEAVY)
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert set(run.stdout.split()) <= {"numpy", "fmpy", "lxml"}


def test_a_worker_that_steps_an_fmu_of_real_numbers_loads_neither_fmpy_nor_numpy(tmp_path):
    description = describe("dc_motor")
    extract(description.path, tmp_path)
    script = f"""
import sys
from estimator.stepping import worker
from estimator.stepping.fmu_instance import FmuInstance
from estimator.stepping.layout import JobLayout
none = dict.fromkeys(("parameter_references", "input_references", "output_references", "sensors", "experiments"), ())
named = dict(folder={str(tmp_path)!r}, identifier="dc_motor", guid={description.guid!r})
loaded = FmuInstance(JobLayout(**named, **none), 0)
assert loaded.fmu.do_step and loaded.fmu.instantiate
loaded.close()
print(*{{"fmpy", "numpy"}} & set(sys.modules))
"""
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert run.stdout.split() == []
