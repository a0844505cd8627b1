"""FMUs for other platforms: headers and exports of the binaries that cannot be run here, the own one run."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import struct
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

import fmu_build
import fmu_build.platforms
from fmu_build.compiler import compile_library, find_compiler, fmi_headers
from fmu_build.platforms import PLATFORMS, native_tuple, universal_binary, zig_compiler
from fmu_build.sources import find_source, fmu_sources

needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")
HERE = Path(__file__).parent
GLIBC_OF_ARM = Path("/usr/aarch64-linux-gnu")  # Debian's libc6-arm64-cross


def declared(version: int) -> set[str]:
    """Return the functions of an FMI version, by its header."""
    header = (fmi_headers() / f"fmi{version}Functions.h").read_text()
    names = re.findall(rf"^#define (fmi{version}[A-Z]\w*) +fmi{version}FullName\(", header, re.M)
    return set(names) - {f"fmi{version}FullName"}


def exported(data: bytes) -> set[str]:
    """Return the exported fmi functions, by the names in the tables of the file."""
    return {name.decode() for name in re.findall(rb"(?<![A-Za-z0-9])_?(fmi[23][A-Z]\w+)\0", data)}


def machine(data: bytes) -> str:
    """Return what a library is for, by its header."""
    if data[:4] == b"\x7fELF" and data[4] == 2:
        return {62: "x86_64", 183: "aarch64"}[struct.unpack("<H", data[18:20])[0]] + "-linux"
    if data[:2] == b"MZ":
        (offset,) = struct.unpack("<I", data[60:64])
        assert data[offset : offset + 4] == b"PE\0\0"
        assert struct.unpack("<H", data[offset + 22 : offset + 24])[0] & 0x2000  # a DLL
        return {0x8664: "x86_64"}[struct.unpack("<H", data[offset + 4 : offset + 6])[0]] + "-windows"
    magic, processor, _, kind = struct.unpack("<IIII", data[:16])
    assert magic == 0xFEEDFACF and kind == 6  # MH_DYLIB
    return {0x01000007: "x86_64", 0x0100000C: "aarch64"}[processor] + "-darwin"


@needs_zig
@pytest.mark.full
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", fmu_build.bundled_names())
def test_every_platform_gets_its_binary_with_all_functions(tmp_path: Path, model: str, fmi: int) -> None:
    fmu = fmu_build.build(model, output=tmp_path / "all.fmu", fmi=fmi, platforms=list(PLATFORMS))
    with zipfile.ZipFile(fmu) as archive:
        files = {n.split("/")[1]: archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}
    assert set(files) == {p.folder if fmi == 2 else p.tuple for p in PLATFORMS.values()}
    if "darwin64" in files:  # one library for both processors
        data = files.pop("darwin64")
        magic, count = struct.unpack(">II", data[:8])
        assert (magic, count) == (0xCAFEBABE, 2)
        for k in range(count):
            _, _, offset, size, _ = struct.unpack(">IIIII", data[8 + 20 * k : 28 + 20 * k])
            files[("x86_64-darwin", "aarch64-darwin")[k]] = data[offset : offset + size]
    for folder, data in files.items():
        assert machine(data) == {"linux64": "x86_64-linux", "win64": "x86_64-windows"}.get(folder, folder)
        assert exported(data) >= declared(fmi), folder
        versions = [tuple(map(int, v.split(b"."))) for v in re.findall(rb"GLIBC_(\d+\.\d+)", data)]
        assert all(version <= (2, 17) for version in versions)
        assert bool(versions) == ("linux" in folder)


@needs_zig
@pytest.mark.skipif(native_tuple() != "x86_64-linux", reason="runs what is built for x86_64-linux")
def test_binary_that_zig_compiles_runs_as_the_other(tmp_path: Path) -> None:
    fmu = fmu_build.build("dc_motor", output=tmp_path / "zig.fmu", platforms=["linux64"])
    runs = []
    for path in (fmu, fmu_build.bundled("dc_motor")):
        run = subprocess.run(
            [sys.executable, str(HERE / "importers.py"), "fmpy", str(path)], capture_output=True, text=True, check=True
        )
        runs.append([[float.fromhex(word) for word in line.split()] for line in run.stdout.splitlines()])
    for one, other in zip(*runs, strict=True):
        assert one == pytest.approx(other, rel=1e-12)


@needs_zig
def test_without_a_c_compiler_zig_takes_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    command = find_compiler()
    assert command[1:4] == ["-m", "ziglang", "cc"] and command[-2] == "-target"
    source = tmp_path / "dc_motor_fmu.c"
    for name, text in fmu_sources(find_source("dc_motor"))[0].items():
        (tmp_path / name).write_bytes(text)
    compile_library(source, tmp_path / "library", include=[fmi_headers()], warnings_are_errors=True)
    assert exported((tmp_path / "library").read_bytes()) >= declared(2)


@needs_zig
@pytest.mark.full
@pytest.mark.skipif(shutil.which("qemu-aarch64") is None, reason="qemu-user is not installed")
@pytest.mark.skipif(not GLIBC_OF_ARM.is_dir(), reason="libc6-arm64-cross is not installed")
@pytest.mark.skipif(native_tuple() != "x86_64-linux", reason="compares with x86_64-linux")
@pytest.mark.parametrize("model", fmu_build.bundled_names())
def test_binary_for_linux_on_arm_gets_under_qemu_what_that_for_x86_gets(tmp_path: Path, model: str) -> None:
    wanted = ["linux64", "linux-aarch64"]
    fmu = fmu_build.build(model, output=tmp_path / "both.fmu", platforms=wanted)
    description = fmpy.read_model_description(str(fmu))
    count = len([v for v in description.modelVariables if v.causality in ("input", "output", "parameter")])
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    runs = []
    for name in wanted:
        platform = PLATFORMS[name]
        program = tmp_path / name
        compiler = zig_compiler(platform.target)
        assert compiler is not None
        options = [f"-I{fmi_headers()}", str(HERE / "steps.c"), "-o", str(program), "-ldl"]
        subprocess.run([*compiler, *options], check=True, capture_output=True)
        library = tmp_path / "binaries" / platform.folder / f"{model}.so"
        before = ["qemu-aarch64", "-L", str(GLIBC_OF_ARM)] if name == "linux-aarch64" else []
        command = [*before, str(program), str(library), description.guid, str(count)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        runs.append(np.array([[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()]))
    x86, arm = runs
    assert x86.shape == (200, count) and np.abs(x86).max(axis=0).min() >= 0 and np.abs(x86[:, 0]).max() == 9
    assert np.all(np.abs(x86 - arm) <= 1e-9 * np.abs(x86).max(axis=0))


@needs_zig
@pytest.mark.full
def test_installed_without_a_system_compiler_it_builds_and_estimates(tmp_path: Path) -> None:
    source, place = tmp_path / "source", tmp_path / "venv"
    left_out = shutil.ignore_patterns(".git", ".venv*", "*.so", "*.fmu", "__pycache__", ".*_cache", "dist", "build")
    shutil.copytree(HERE.parent, source, ignore=left_out)
    venv.create(place, with_pip=True)
    programs = place / "bin"
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "CC")}
    environment["PATH"] = str(programs)  # no cc, no gcc, no clang

    def run(*command: str | Path) -> str:
        words = [str(word) for word in command]
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
        return done.stdout

    run(programs / "pip", "install", "-q", "ziglang", "hatchling", "fmpy")
    run(programs / "pip", "install", "-q", "--no-build-isolation", source)
    told = run(programs / "fmu-estimator", "estimate", source / "examples" / "cml050_step.csv")
    assert told.startswith("OK: ")
    assert run(programs / "fmu-estimator", "new-model", "mine") and run(programs / "fmu-estimator", "build", "mine.c")
    (library,) = (place / "lib").glob("python*/site-packages/estimator/stepping/stepper.so")
    versions = {tuple(map(int, v.split(b"."))) for v in re.findall(rb"GLIBC_(\d+\.\d+)", library.read_bytes())}
    assert max(versions) <= (2, 17)


def test_platforms_that_do_not_exist_or_cannot_be_compiled_for_are_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "x.fmu"
    with pytest.raises(fmu_build.BuildError, match="no platform 'linux32'; there are linux64, linux-aarch64, win64"):
        fmu_build.build("dc_motor", output=target, platforms=["linux64", "linux32"])
    with pytest.raises(fmu_build.BuildError, match="no platform is named; there are linux64"):
        fmu_build.build("dc_motor", output=target, platforms=[])
    monkeypatch.setattr(fmu_build.platforms, "find_spec", lambda name: None)
    assert zig_compiler() is None
    with pytest.raises(fmu_build.BuildError, match="compiled for by zig; install the Python package ziglang"):
        fmu_build.build("dc_motor", output=target, platforms=["win64"])
    with pytest.raises(fmu_build.BuildError, match="no macOS library of 64 bits"):
        universal_binary([b"\x7fELF" + bytes(20)])
    assert not target.exists()
