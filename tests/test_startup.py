"""Commands import what they need and no more: what is imported is what start-up costs."""

import subprocess
import sys
from pathlib import Path

import pytest

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
