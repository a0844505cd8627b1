"""Wheel and sdist, installed into a clean environment and run from outside the checkout."""

import importlib.util
import io
import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

VARIABLE = "FMU_ESTIMATOR_WHEEL"
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


def test_a_wheel_for_an_index_needs_no_newer_glibc_than_its_tag_says(tmp_path):
    if importlib.util.find_spec("ziglang") is None:
        pytest.skip("ziglang is not installed")
    shutil.copytree(ROOT, tmp_path / "source", ignore=LEFT_OUT)
    environment = {**os.environ, VARIABLE: "linux64"}
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path / "dist")]
    done = subprocess.run(command, cwd=tmp_path / "source", capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    assert wheel.name.endswith("-py3-none-manylinux_2_17_x86_64.whl")
    needed = newest_glibc(zipfile.ZipFile(wheel))
    assert len(needed) >= 7 and max(needed.values()) <= 17, needed
    wrong = subprocess.run(
        command, cwd=tmp_path / "source", capture_output=True, text=True, env={**environment, VARIABLE: "linux"}
    )
    assert "FMU_ESTIMATOR_WHEEL cannot be 'linux'; it is one of linux64, linux-aarch64, or not set" in wrong.stderr


def newest_glibc(archive):
    """Return the newest glibc 2.x that each library in a wheel asks for, those in FMUs too."""
    found = {}
    for name in archive.namelist():
        data = archive.read(name)
        if name.endswith(".fmu"):
            with zipfile.ZipFile(io.BytesIO(data)) as inner:
                found |= {f"{name}/{k}": v for k, v in newest_glibc(inner).items()}
        elif name.endswith(".so"):
            found[name] = max(int(v) for v in re.findall(rb"GLIBC_2\.(\d+)", data))
    return found
