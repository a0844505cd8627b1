"""FMUs for other platforms: headers and exports of the binaries that cannot be run here, the own one run."""

from __future__ import annotations

import importlib.util
import re
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import fmu_build
import fmu_build.platforms
from fmu_build.compiler import compile_library, find_compiler, fmi_headers
from fmu_build.platforms import PLATFORMS, native_tuple, universal_binary, zig_compiler
from fmu_build.sources import find_source, fmu_sources

needs_zig = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="ziglang is not installed")
HERE = Path(__file__).parent


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
def test_every_platform_gets_its_binary_with_all_functions(tmp_path: Path, fmi: int) -> None:
    fmu = fmu_build.build("dc_motor", output=tmp_path / "all.fmu", fmi=fmi, platforms=list(PLATFORMS))
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
