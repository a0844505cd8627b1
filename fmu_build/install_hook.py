"""Compiles at install: the loops in C and the bundled FMUs. Knows hatchling and where the sources lie.

A wheel is for the machine that builds it. With FMU_ESTIMATOR_WHEEL set to a name of `INDEX` it is one that a package
index takes, for any Linux of that processor since glibc 2.17, compiled by ziglang:

    FMU_ESTIMATOR_WHEEL=linux64 python -m build
"""

from __future__ import annotations

import os
import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "FMU_ESTIMATOR_WHEEL"
INDEX = {"linux64": "manylinux_2_17_x86_64", "linux-aarch64": "manylinux_2_17_aarch64"}  # platform → tag (PEP 600)


class CustomBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Compile into the source tree, where an editable install finds it, and add what was compiled to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile for the machine that installs, and tag the wheel with its platform."""
        if self.target_name != "wheel":
            return
        root = Path(self.root)
        sys.path.insert(0, self.root)
        try:
            from fmu_build.errors import BuildError

            try:
                platform = _platform()
                artifacts = [*_compile_loops(root / "estimator" / "stepping", platform), *_build_models(platform)]
            except BuildError as error:
                raise SystemExit(f"fmu-estimator cannot be installed: {error}") from None  # one sentence, no traceback
        finally:
            sys.path.remove(self.root)
        if version == "standard":  # an editable install finds these beside the package
            build_data["force_include"] |= {"models": "fmu_build/models", "LICENSE": "fmu_build/LICENSE"}
        build_data["artifacts"] += [f"/{path.relative_to(root).as_posix()}" for path in artifacts]
        build_data["pure_python"] = False
        own = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{INDEX[platform] if platform else own}"


def _platform() -> str:
    """Return the platform that the wheel is for; "" for this machine."""
    from fmu_build.errors import BuildError
    from fmu_build.platforms import zig_compiler

    wanted = os.environ.get(VARIABLE, "")
    if wanted and wanted not in INDEX:
        raise BuildError(f"{VARIABLE} cannot be {wanted!r}; it is one of {', '.join(INDEX)}, or not set")
    if wanted and zig_compiler() is None:
        raise BuildError(f"a wheel for {wanted} needs the compiler of the package ziglang; install it beside")
    return wanted


def _compile_loops(folder: Path, platform: str) -> list[Path]:
    from fmu_build.compiler import VECTORISED, compile_library, fmi_headers, library_suffix
    from fmu_build.platforms import PLATFORMS, zig_compiler

    compiler = zig_compiler(PLATFORMS[platform].target) if platform else None
    libraries = []
    for name, options in (("stepper.c", ()), ("kalman.c", VECTORISED)):
        if (source := folder / name).is_file():
            libraries.append(source.with_suffix(library_suffix()))
            compile_library(source, libraries[-1], include=[fmi_headers()], options=options, compiler=compiler)
    return libraries


def _build_models(platform: str) -> list[Path]:
    import fmu_build
    from fmu_build.bundle import BUNDLED

    if not platform:
        return [fmu_build.bundled(name) for name in fmu_build.bundled_names()]
    BUNDLED.mkdir(exist_ok=True)
    return [
        fmu_build.build(name, output=BUNDLED / f"{name}.fmu", platforms=[platform])
        for name in fmu_build.bundled_names()
    ]
