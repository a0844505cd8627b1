"""Compiles at install: the loops in C and the bundled FMUs. Knows hatchling and where the sources lie."""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


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
                artifacts = [*_compile_loops(root / "estimator" / "stepping"), *_build_models()]
            except BuildError as error:
                raise SystemExit(f"fmu-estimator cannot be installed: {error}") from None  # one sentence, no traceback
        finally:
            sys.path.remove(self.root)
        if version == "standard":  # an editable install finds these beside the package
            build_data["force_include"] |= {"models": "fmu_build/models", "LICENSE": "fmu_build/LICENSE"}
        build_data["artifacts"] += [f"/{path.relative_to(root).as_posix()}" for path in artifacts]
        build_data["pure_python"] = False
        platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["tag"] = f"py3-none-{platform}"


def _compile_loops(folder: Path) -> list[Path]:
    from fmu_build.compiler import VECTORISED, compile_library, fmi_headers, library_suffix

    libraries = []
    for name, options in (("stepper.c", ()), ("kalman.c", VECTORISED)):
        if (source := folder / name).is_file():
            libraries.append(source.with_suffix(library_suffix()))
            compile_library(source, libraries[-1], include=[fmi_headers()], options=options)
    return libraries


def _build_models() -> list[Path]:
    import fmu_build

    return [fmu_build.bundled(name) for name in fmu_build.bundled_names()]
