"""The C of every built FMU under warnings, sanitizers and valgrind, driven by random sequences of calls."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import fmu_build
from fmu_build.compiler import WARNINGS, find_compiler, fmi_headers
from fmu_build.sources import find_source, fmu_sources, unit_name

DRIVER = Path(__file__).parent / "fuzz_calls.c"
MODELS = fmu_build.bundled_names()
VERSIONS = (2, 3)
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-fno-omit-frame-pointer")

full = pytest.mark.full
Driver = Callable[..., Path]


def write_sources(folder: Path, model: str, fmi: int) -> Path:
    """Write what lies in sources/ of a model's FMU; return the translation unit."""
    source = find_source(model)
    for name, text in fmu_sources(source, fmi=fmi)[0].items():
        (folder / name).write_bytes(text)
    return folder / unit_name(source)


def compiled(source: Path, output: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [*find_compiler(), "-std=c11", f"-I{fmi_headers()}", *options, str(source), "-o", str(output), "-lm"]
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, "LC_ALL": "C"})


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> Driver:
    """Return what compiles the driver with a model's FMU inside, each once."""

    @cache
    def compile_it(model: str, fmi: int, *options: str, spoil: tuple[str, str, str] | None = None) -> Path:
        folder = tmp_path_factory.mktemp("driver")
        unit = write_sources(folder, model, fmi)
        if spoil:
            name, old, new = spoil
            text = (folder / name).read_text()
            assert old in text
            (folder / name).write_text(text.replace(old, new))
        program = folder / "fuzz"
        defines = (f"-DFMI={fmi}", f'-DUNIT="{unit.name}"', f"-I{folder}", "-g1", "-O0")
        done = compiled(DRIVER, program, *defines, *options)
        if done.returncode != 0 and "sanitize" in " ".join(options) and "fuzz_calls" not in done.stderr:
            pytest.skip(f"the compiler has no sanitizers: {done.stderr.strip().splitlines()[-1]}")
        assert done.returncode == 0, done.stderr[-3000:]
        return program

    return compile_it


def run(*command: str | Path) -> str:
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-4000:]
    return done.stdout


@pytest.mark.parametrize(
    ("model", "fmi"),
    [
        pytest.param(model, fmi, marks=() if fmi == 3 or model == "dc_motor" else full)
        for model in MODELS
        for fmi in VERSIONS
    ],
)
def test_every_model_compiles_without_a_warning(tmp_path: Path, model: str, fmi: int) -> None:
    done = compiled(write_sources(tmp_path, model, fmi), tmp_path / "unit.o", "-O2", "-c", *WARNINGS, "-Werror")
    assert done.returncode == 0, done.stderr[-3000:]


SAMPLE = [("dc_motor_friction", fmi, 100) for fmi in VERSIONS]
LARGE = [pytest.param(model, fmi, 30_000, marks=full) for model in MODELS for fmi in VERSIONS]


@pytest.mark.parametrize(("model", "fmi", "sequences"), [*SAMPLE, *LARGE])
def test_random_calls_never_crash_and_never_return_what_is_not_finite(
    driver: Driver, model: str, fmi: int, sequences: int
) -> None:
    calls, successes = map(int, run(driver(model, fmi, *SANITIZERS), "1", str(sequences)).split())
    assert calls > 50 * sequences and 0.2 < successes / calls < 0.8  # both ways are taken


@full
@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize(
    "spoil",
    [
        pytest.param(("instance.c", "return array != NULL || count == 0;", "return true;"), id="NULL"),
        pytest.param(("instance.c", "references[k] >= N_VARIABLES)", "references[k] > 99)"), id="beyond the table"),
        pytest.param(("instance.c", "values[k] >= row->min && values[k] <= row->max", "true"), id="not finite"),
    ],
)
def test_random_calls_find_a_planted_fault(driver: Driver, fmi: int, spoil: tuple[str, str, str]) -> None:
    program = driver("dc_motor_friction", fmi, *SANITIZERS, spoil=spoil)
    assert subprocess.run([program, "1", "5000"], capture_output=True).returncode != 0


@pytest.mark.parametrize(
    ("model", "fmi"),
    [
        pytest.param(model, fmi, marks=() if (model, fmi) == SAMPLE[0][:2] else full)
        for model in MODELS
        for fmi in VERSIONS
    ],
)
def test_ten_thousand_instances_leave_nothing_behind(driver: Driver, model: str, fmi: int) -> None:
    assert run(driver(model, fmi, *SANITIZERS), "1", "10000", "instances") == "10000 10000\n"


@full
@pytest.mark.parametrize("fmi", VERSIONS)
def test_an_instance_that_is_not_freed_is_found(driver: Driver, fmi: int) -> None:
    freed = "    free(component);\n}" if fmi == 2 else "    free(instance);"
    program = driver("dc_motor", fmi, *SANITIZERS, spoil=(f"fmi{fmi}.c", freed, "    (void)0;" + "}" * (fmi == 2)))
    done = subprocess.run([program, "1", "10", "instances"], capture_output=True, text=True)
    assert done.returncode != 0 and "LeakSanitizer" in done.stderr


@full
@pytest.mark.skipif(shutil.which("valgrind") is None, reason="valgrind is not installed")
@pytest.mark.parametrize("fmi", VERSIONS)
@pytest.mark.parametrize("model", MODELS)
def test_valgrind_finds_nothing_in_ten_thousand_instances_and_random_calls(
    driver: Driver, model: str, fmi: int
) -> None:
    program = driver(model, fmi)
    valgrind = ("valgrind", "-q", "--error-exitcode=9", "--leak-check=full", "--show-leak-kinds=all")
    assert run(*valgrind, program, "1", "10000", "instances") == "10000 10000\n"
    run(*valgrind, program, "2", "300")
