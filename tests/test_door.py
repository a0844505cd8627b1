"""The way into the program: Ctrl-C while it is loaded ends it in one sentence, and later is the command's business."""

import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from interrupts import takes_interrupts

ROOT = Path(__file__).resolve().parent.parent

# The program, with Ctrl-C pressed by itself when a module is about to be imported.
SCRIPT = """
import os, signal, sys
class Presses:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Presses())
sys.argv = ["fmu-estimator", "estimate", {recording!r}, "-o", "out"]
from estimator.door import main
sys.exit(main())
"""


def ran(script, folder, *, before):
    """Run a script of Python's in a process of its own, in which `before` was called."""
    return subprocess.run(
        [sys.executable, "-c", script],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
        preexec_fn=before,
    )


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to a process is POSIX")
@pytest.mark.parametrize("module", ["estimator.cli", "argparse", "estimator.commands.estimation", "numpy", "fmpy"])
def test_ctrl_c_while_the_program_is_loaded_ends_in_one_sentence(tmp_path, module):
    script = SCRIPT.format(module=module, recording=str(ROOT / "examples" / "cml050_step.csv"))
    run = ran(script, tmp_path, before=takes_interrupts)
    assert (run.returncode, run.stdout, run.stderr) == (130, "", "fmu-estimator: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to a process is POSIX")
def test_ctrl_c_of_which_an_extension_that_is_loaded_makes_another_error_is_told_as_what_it_is(tmp_path):
    script = SCRIPT.format(module="fmpy", recording=str(ROOT / "examples" / "cml050_step.csv")).replace(
        "            os.kill(os.getpid(), signal.SIGINT)",
        """            try:
                os.kill(os.getpid(), signal.SIGINT)
                os.getpid()
            except KeyboardInterrupt:
                raise ImportError("initialization failed") from None""",
    )
    run = ran(script, tmp_path, before=takes_interrupts)
    assert (run.returncode, run.stdout, run.stderr) == (130, "", "fmu-estimator: interrupted\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="SIGINT to a process is POSIX")
def test_where_ctrl_c_is_ignored_as_in_the_background_it_stays_so(tmp_path):
    script = SCRIPT.format(module="numpy", recording="none.csv")
    run = ran(script, tmp_path, before=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN))
    assert run.returncode == 2 and "none.csv" in run.stderr


def test_every_way_into_the_program_goes_through_the_door():
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]
    assert scripts == {"fmu-estimator": "estimator.door:main"}
    assert "estimator.door" in (ROOT / "estimator" / "__main__.py").read_text()
