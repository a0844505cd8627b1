"""FMUs that misbehave on purpose: dc_motor.fmu rebuilt from its own sources with one function wrapped.

The wrapper stands for the original and may call it as ``original_<name>``.
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
    original = fmu_build.bundled("dc_motor")
    work = folder / "faulty"
    work.mkdir(parents=True)
    with zipfile.ZipFile(original) as archive:
        archive.extractall(work)
    names = ["fmi2" + name for name in faults]
    (entry,) = [p for p in (work / "sources").glob("*_fmu.c")]
    text = PRELUDE + "".join(f"#undef {name}\n#define {name} original_{name}\n" for name in names)
    text += f'#include "{entry.name}"\n' + "".join(f"#undef {name}\n" for name in names)
    for name, body in zip(names, faults.values(), strict=True):
        kind, parameters, arguments = SIGNATURES[name]
        text += (
            f"{kind} {name}({parameters})\n{{\n"
            f"#define ORIGINAL original_{name}({arguments})\n{body}\nreturn ORIGINAL;\n#undef ORIGINAL\n}}\n"
        )
    text += besides
    source = work / "faulty.c"
    source.write_text(text)
    library = work / "binaries" / fmpy.platform / ("dc_motor" + fmpy.sharedLibraryExtension)
    compile_library(source, library, include=[work / "sources", fmi_headers()], options=QUICKLY)
    target = folder / "faulty.fmu"
    with zipfile.ZipFile(target, "w") as archive:
        for path in sorted(work.rglob("*")):
            if path.is_file() and path != source:
                archive.write(path, path.relative_to(work).as_posix())
    return target
