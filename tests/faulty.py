"""FMUs that misbehave on purpose: dc_motor.fmu rebuilt from its own sources with some functions wrapped.

The wrapper stands for the original and may call it as ``original_<name>``. What is wrapped is the same for all of them
and compiled apart, so that it is compiled once.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy

import fmu_build
from fmu_build.compiler import compile_library, fmi_headers

SIGNATURES = {
    "fmi2Instantiate": (
        "fmi2Component",
        "fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,"
        " const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging",
        "name, type, guid, resources, functions, visible, logging",
    ),
    "fmi2EnterInitializationMode": ("fmi2Status", "fmi2Component c", "c"),
    "fmi2Reset": ("fmi2Status", "fmi2Component c", "c"),
    "fmi2DoStep": (
        "fmi2Status",
        "fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean no_set_state",
        "c, time, h, no_set_state",
    ),
    "fmi2GetReal": (
        "fmi2Status",
        "fmi2Component c, const fmi2ValueReference references[], size_t n, fmi2Real values[]",
        "c, references, n, values",
    ),
    "fmi2SetReal": (
        "fmi2Status",
        "fmi2Component c, const fmi2ValueReference references[], size_t n, const fmi2Real values[]",
        "c, references, n, values",
    ),
}

QUICKLY = ("-O0",)  # compiled in a quarter of the time, and the same bits

PRELUDE = """#define _GNU_SOURCE
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "fmi2Functions.h"
"""


def faulty_fmu(folder: Path, *, besides: str = "", **faults: str) -> Path:
    """Build dc_motor.fmu with wrapped functions, and C besides them, into `folder`.

    Each keyword is an FMI function's name without ``fmi2``, its value the body of the wrapper: C statements that may
    use the arguments and ``ORIGINAL``, the result of the wrapped function, and that return a value or fall through to
    returning ``ORIGINAL``.
    """
    work = folder / "faulty"
    work.mkdir(parents=True)
    with zipfile.ZipFile(fmu_build.bundled("dc_motor")) as archive:
        archive.extractall(work)
    sources = [work / "sources", fmi_headers()]
    (entry,) = [p for p in (work / "sources").glob("*_fmu.c")]
    original, rest, source = work / "original.c", work / "original.o", work / "faulty.c"
    renamed = "".join(f"#undef {name}\n#define {name} original_{name}\n" for name in SIGNATURES)
    original.write_text(f'#include "fmi2Functions.h"\n{renamed}#include "{entry.name}"\n')
    compile_library(original, rest, include=sources, options=(*QUICKLY, "-c"))
    source.write_text(PRELUDE + "".join(_wrapper(name, faults.pop(name[4:], "")) for name in SIGNATURES) + besides)
    assert not faults, f"SIGNATURES has no {', '.join(faults)}"
    library = work / "binaries" / fmpy.platform / ("dc_motor" + fmpy.sharedLibraryExtension)
    compile_library(source, library, include=sources, options=(*QUICKLY, str(rest)))
    target = folder / "faulty.fmu"
    with zipfile.ZipFile(target, "w") as archive:
        for path in sorted(work.rglob("*")):
            if path.is_file() and path not in (original, source, rest):
                archive.write(path, path.relative_to(work).as_posix())
    return target


def _wrapper(name: str, body: str) -> str:
    """Return the C of a function that wraps the original."""
    kind, parameters, arguments = SIGNATURES[name]
    return (
        f"{kind} original_{name}({parameters});\n{kind} {name}({parameters})\n{{\n"
        f"#define ORIGINAL original_{name}({arguments})\n{body}\nreturn ORIGINAL;\n#undef ORIGINAL\n}}\n"
    )
