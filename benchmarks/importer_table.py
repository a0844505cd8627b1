"""Every bundled model in every importer here: docs/importers.md is what this prints.

``python benchmarks/importer_table.py`` builds all models in FMI 2.0 and 3.0, runs each importer in a process of its own
(tests/importers.py: every parameter changed, inputs that jump, 300 steps of 1 ms) and compares all outputs, bit by bit,
with FMPy's in FMI 2.0. ``--write`` writes the page.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import numpy as np
from numpy.typing import NDArray

import fmu_build
from estimator.commands.drive import instants
from estimator.fmus.fmu import describe, with_kind
from estimator.fmus.simulate import simulate

FloatArray = NDArray[np.float64]

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "importers.md"
PROGRAM = ROOT / "tests" / "importers.py"
IMPORTERS = {"fmpy": "FMPy", "libcosimpy": "libcosimpy", "ecospy": "ecospy", "estimator": "fmu-estimator"}
VERSIONS = (2, 3)
SAME = "same bits"
NOT_TAKEN = {("libcosimpy", 3): "takes FMI 2.0 only"}
SOLVER_TOLERANCE = 1e-10  # relative, CVode's
AGREEMENT = 1e-6  # of the largest value, with a solver at that tolerance

HEAD = """\
# Other tools

Made by `python benchmarks/importer_table.py --write`; `tests/test_fmu_build_importers.py` makes it again.

Each bundled model, built in FMI 2.0 and 3.0, is run by each importer that can be installed from PyPI: every parameter
changed before initialisation, inputs that jump every 7 ms, 300 steps of 1 ms, all outputs after every step. "{same}":
every output of every step is the very number that FMPy gets in FMI 2.0. fmu-estimator is this package's own loop in C.

| model | FMI | kind | {names} |
|---|---|---|{rules}|
"""
TAIL = """

Model exchange: FMPy's CVode at a relative tolerance of {tolerance:g}, from event to event by the event indicators,
and this package's own loop agree with co-simulation to {agreement:g} of each output's largest value. The others import
co-simulation only.

Versions: {versions}. Not tried: Simulink, Dymola and OpenModelica, which are not on PyPI or in Debian; OMSimulator,
whose package downloads at install; PyFMI, which has to be compiled.

## Platforms

`fmu-estimator build MODEL --platforms linux64,linux-aarch64,win64,darwin-x86_64,darwin-aarch64` puts binaries of five
platforms into one FMU. FMI 2.0 names folders `linux64`, `win64` and `darwin64`; the two macOS binaries are one
universal library there. For Linux on ARM, FMI 2.0.5 points to the names of FMI 3.0: the folder is `aarch64-linux`.
FMPy 0.3.32 and OpenModelica take `linux64` on such machines, whatever the processor; so an FMU that is built on an ARM
machine itself, without `--platforms`, has its binary there. Where neither fits, `fmpy compile` builds the sources
inside.

| platform | how it is checked |
|---|---|
| linux64 | run here; symbols no newer than glibc 2.17 |
| linux-aarch64 | run under qemu-user where it is installed, outputs as on x86-64 to rounding; glibc 2.17 |
| win64, darwin-x86_64, darwin-aarch64 | header and exports only: not run |
"""


def run(importer: str, fmu: Path) -> list[str] | str:
    """Return what an importer printed, a line a step, or in a word why it did not run."""
    if importer != "estimator" and importlib.util.find_spec(importer) is None:
        return "not installed"
    loads = subprocess.run([sys.executable, "-c", f"import {importer}"], cwd=ROOT, capture_output=True, text=True)
    if loads.returncode != 0:
        return "cannot be loaded"
    command = [sys.executable, str(PROGRAM), importer, str(fmu)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, env=_environment())
    if done.returncode != 0:
        return f"failed: {(done.stderr.strip().splitlines() or ['no message'])[-1]}"
    return [line for line in done.stdout.splitlines() if line.lstrip("-").startswith("0x")]  # ecos talks


def _environment() -> dict[str, str]:
    import os

    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))}


def exchanged(fmu: Path) -> str:
    """Return whether FMPy's solver, which integrates the FMU, gets what co-simulation gets."""
    description = fmpy.read_model_description(str(fmu))
    inputs = [v for v in description.modelVariables if v.causality == "input"]
    levels = [[0.0, 0.0], [1.0, 0.1], [-0.7, -0.1]]  # held for 0.1 s each, of the inputs' nominal values
    rows = [
        (0.1 * (k + end), *(level[j % 2] * float(v.nominal) for j, v in enumerate(inputs)))
        for k, level in enumerate(levels)
        for end in (0, 1)
    ]
    signal = np.array(rows, dtype=[("time", float), *((v.name, float) for v in inputs)])
    names = [v.name for v in description.modelVariables if v.causality == "output"]
    runs = [
        fmpy.simulate_fmu(
            str(fmu),
            fmi_type=kind,
            input=signal,
            output=names,
            stop_time=0.3,
            output_interval=1e-3,
            relative_tolerance=SOLVER_TOLERANCE,
            logger=None,
        )
        for kind in ("CoSimulation", "ModelExchange")
    ]
    rows_there = np.searchsorted(runs[1]["time"], runs[0]["time"] - 1e-9)
    return _agreement({name: (runs[0][name], runs[1][name][rows_there]) for name in names})


def exchanged_here(fmu: Path) -> str:
    """Return whether this package's loop, which integrates the FMU too, gets what co-simulation gets."""
    description = describe(fmu)
    times = instants(stop=0.3, step=1e-3)
    level = np.repeat([0.0, 1.0, -0.7], [100, 100, 101])
    inputs = {
        v.name: level * (v.nominal or 1.0) / (1, 10)[j % 2] for j, v in enumerate(description.of_causality("input"))
    }
    runs = [
        simulate(with_kind(description, kind), parameters={}, inputs=inputs, times=times) for kind in description.kinds
    ]
    return _agreement({name: (runs[0][name], runs[1][name]) for name in runs[0]})


def _agreement(signals: Mapping[str, tuple[FloatArray, FloatArray]]) -> str:
    """Say how far signals lie apart, over their largest values; one may stay at 0."""
    worst = max(float(np.abs(b - a).max()) / (float(np.abs(a).max()) or 1.0) for a, b in signals.values())
    return f"agrees to {AGREEMENT:g}" if worst < AGREEMENT else f"differs by {worst:.1g}"


def table(models: tuple[str, ...], versions: tuple[int, ...] = VERSIONS) -> list[list[str]]:
    """Return the rows: model, version, kind, and a cell for each importer."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for model in models:
            reference: list[str] | str = ""
            for fmi in versions:
                fmu = fmu_build.build(model, output=Path(folder) / f"{model}_{fmi}.fmu", fmi=fmi)
                cells = []
                for importer in IMPORTERS:
                    lines = NOT_TAKEN.get((importer, fmi)) or run(importer, fmu)
                    reference = reference or lines
                    cells.append(lines if isinstance(lines, str) else SAME if lines == reference else "differs")
                rows.append([model, f"{fmi}.0", "co-simulation", *cells])
                rows.append(
                    [model, f"{fmi}.0", "model exchange", exchanged(fmu), *["not offered"] * 2, exchanged_here(fmu)]
                )
    return rows


def page(rows: list[list[str]]) -> str:
    """Return the page."""
    names = " | ".join(IMPORTERS.values())
    text = HEAD.format(same=SAME, names=names, rules="|".join(["---"] * len(IMPORTERS)))
    text += "".join(f"| {' | '.join(row)} |\n" for row in rows)
    installed = [name for name in ("fmpy", "libcosimpy", "ecospy") if importlib.util.find_spec(name)]
    versions = ", ".join(f"{IMPORTERS[name]} {importlib.metadata.version(name)}" for name in installed)
    return text + TAIL.format(tolerance=SOLVER_TOLERANCE, agreement=AGREEMENT, versions=versions)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help=f"write {PAGE.relative_to(ROOT)}")
    args = parser.parse_args()
    if shutil.which("cc") is None and not importlib.util.find_spec("ziglang"):
        parser.error("a C compiler is needed; install gcc or the Python package ziglang")
    text = page(table(fmu_build.bundled_names()))
    if args.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text, end="")


if __name__ == "__main__":
    main()
