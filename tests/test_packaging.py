"""Wheel and sdist, installed into a clean environment and run from outside the checkout."""

import json
import os
import shutil
import subprocess
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv*", "*.so", "*.fmu", "__pycache__", ".pytest_cache", ".mypy_cache", ".ruff_cache", "dist", "build"
)

pytestmark = pytest.mark.full


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([str(c) for c in command], cwd=cwd, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Return wheel and sdist, built from a copy of the sources."""
    if shutil.which("git") is None:
        pytest.skip("git is not installed")
    folder = tmp_path_factory.mktemp("build")
    shutil.copytree(ROOT, folder / "source", ignore=LEFT_OUT)
    tools = folder / "tools"
    venv.create(tools, with_pip=True)
    run(tools / "bin" / "pip", "install", "-q", "build", cwd=folder)
    run(tools / "bin" / "python", "-m", "build", "-o", folder / "dist", folder / "source", cwd=folder)
    (wheel,) = (folder / "dist").glob("*.whl")
    (sdist,) = (folder / "dist").glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_installed_in_a_clean_environment_the_demo_runs(built, kind, tmp_path):
    venv.create(tmp_path / "venv", with_pip=True)
    programs = tmp_path / "venv" / "bin"
    run(programs / "pip", "install", "-q", built[kind], cwd=tmp_path)
    done = run(programs / "fmu-estimator", "demo", "-o", "out", cwd=tmp_path)
    assert "\nOK: " in done.stdout
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {
        "result.json",
        "report.html",
        "parameters.ssv",
        "figure.png",
    }
    fmu = Path(json.loads((tmp_path / "out" / "result.json").read_text())["fmu"]["path"])
    assert fmu.is_relative_to(tmp_path / "venv"), "the installed FMU, not the checkout's"
    assert "dc_motor.ssp" in run(programs / "fmu-estimator", "export", "out", cwd=tmp_path).stdout
    code = "import estimator; print(estimator.describe_fmu('dc_motor').name)"
    assert run(programs / "python", "-c", code, cwd=tmp_path).stdout == "dc_motor\n"


def test_the_wheel_holds_the_compiled_parts_and_no_tests(built):
    names = zipfile.ZipFile(built["wheel"]).namelist()
    for loop in ("stepper", "kalman"):
        assert any(n.startswith(f"estimator/stepping/{loop}.") and not n.endswith(".c") for n in names)
    modules = {path.relative_to(ROOT).as_posix() for path in (ROOT / "estimator").rglob("*.py")}
    assert modules <= set(names)
    assert "fmu_build/bundled/dc_motor.fmu" in names and "fmu_build/models/dc_motor.c" in names
    assert not any(n.startswith(("tests/", "docs/", "examples/")) for n in names)
