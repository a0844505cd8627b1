"""A built FMU in other tools: other importers step it to the same bits, and its sources rebuild it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from fmu_instances import Opened
from importers import STEPS
from test_docs import loaded

import fmu_build
from fmu_build.compiler import find_compiler

pytestmark = pytest.mark.usefixtures("compiled_quickly")
HERE = Path(__file__).parent
importer_table = loaded(HERE.parent / "benchmarks" / "importer_table.py")


def run_importer(name: str, fmu: Path) -> list[str]:
    """Return what an importer printed, a line a step; skip where it is not installed or cannot be loaded."""
    lines = importer_table.run(name, fmu)
    if lines in ("not installed", "cannot be loaded"):
        pytest.skip(f"{name} is {lines}")
    assert isinstance(lines, list), lines
    return lines


@pytest.fixture(scope="module", params=[2, 3], ids=["FMI2", "FMI3"])
def fmu(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("importers") / "dc_motor.fmu"
    return fmu_build.build("dc_motor", output=output, fmi=request.param)


@pytest.fixture(scope="module")
def by_fmpy() -> list[str]:
    return run_importer("fmpy", fmu_build.bundled("dc_motor"))


@pytest.mark.parametrize("name", importer_table.IMPORTERS)
def test_importers_get_the_same_bits_in_both_versions_of_fmi(name: str, fmu: Path, by_fmpy: list[str]) -> None:
    if name == "libcosimpy" and b'fmiVersion="3.0"' in zipfile.ZipFile(fmu).read("modelDescription.xml"):
        pytest.skip("libcosimpy takes FMI 2.0 only")
    assert len(by_fmpy) == STEPS
    assert run_importer(name, fmu) == by_fmpy


def written_rows() -> list[list[str]]:
    lines = [line.strip("| ").split(" | ") for line in importer_table.PAGE.read_text().splitlines()]
    return [row for row in lines if row[0] in fmu_build.bundled_names()]


def test_page_on_importers_lists_every_model_and_says_that_all_agree() -> None:
    rows = [row for row in written_rows() if row[2] == "co-simulation"]
    assert [tuple(row[:2]) for row in rows] == [(m, f"{fmi}.0") for m in fmu_build.bundled_names() for fmi in (2, 3)]
    for row in rows:
        assert set(row[3:]) <= {"same bits", "takes FMI 2.0 only"}, row


def test_the_own_loop_integrates_model_exchange_to_what_co_simulation_gives(fmu: Path) -> None:
    cells = {row[-1] for row in written_rows() if row[2] == "model exchange"}
    assert cells == {importer_table.exchanged_here(fmu)} == {"agrees to 1e-06"}


@pytest.mark.full
def test_page_on_importers_is_what_its_command_prints() -> None:
    rows = importer_table.table(fmu_build.bundled_names())
    for made, row in zip(rows, written_rows(), strict=True):
        for cell, written in zip(made, row, strict=True):
            assert cell in (written, "not installed", "cannot be loaded"), row


def rebuilt(fmu: Path, target: Path) -> Path:
    """Return a copy of an FMU with binaries that `fmpy compile` made from its sources, with CMake."""
    if shutil.which("cmake") is None or shutil.which("make") is None:
        pytest.skip("cmake and make are not both installed")
    with zipfile.ZipFile(fmu) as original, zipfile.ZipFile(target, "w") as bare:
        for name in original.namelist():
            if not name.startswith("binaries/"):
                bare.writestr(name, original.read(name))
    environment = os.environ | {"CC": find_compiler()[0]}
    command = [sys.executable, "-m", "fmpy", "compile", str(target)]
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    return target


@pytest.mark.parametrize("fmu", [3, pytest.param(2, marks=pytest.mark.full)], ids=["FMI3", "FMI2"], indirect=True)
def test_rebuilt_from_its_own_sources_it_gives_the_same_bits(tmp_path: Path, fmu: Path, by_fmpy: list[str]) -> None:
    assert run_importer("fmpy", rebuilt(fmu, tmp_path / "dc_motor.fmu")) == by_fmpy


@pytest.mark.full
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", fmu_build.bundled_names())
def test_every_model_rebuilt_from_its_own_sources_gives_the_same_bits(tmp_path: Path, model: str, fmi: int) -> None:
    own = fmu_build.build(model, output=tmp_path / "own.fmu", fmi=fmi)
    assert run_importer("fmpy", rebuilt(own, tmp_path / f"{model}.fmu")) == run_importer("fmpy", own)


def test_fmpy_simulates_it_with_its_own_defaults(tmp_path: Path) -> None:
    import fmpy
    import numpy as np

    signal = np.array([(0.0, 0.0), (0.5, 0.0), (0.5, 10.5), (2.8, 10.5)], dtype=[("time", float), ("v", float)])
    result = fmpy.simulate_fmu(str(fmu_build.bundled("dc_motor")), input=signal, output_interval=1e-3)
    assert result["time"][-1] == pytest.approx(2.8)
    # R i + K w = v and K i = B w when it has settled
    assert result["w"][-1] == pytest.approx(10.5 * 0.048774 / (3.1363 * 1.69e-4 + 0.048774**2), rel=1e-9)


def test_many_instances_leave_nothing_open() -> None:
    with Opened(fmu_build.bundled("dc_motor")) as opened:
        motor = opened.instance()
        fmi = motor.fmi
        for _ in range(1000):
            fmi.fmi2FreeInstance(fmi.component)
            fmi.instantiate()
            motor.start()
            motor.step(0.0, 1e-3)
