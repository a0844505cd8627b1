"""C source to shared library, by whatever C compiler is there. Knows nothing of models or FMUs.

A compiler is a command, given as a list of words, that understands gcc's options; so ``[python, "-m", "ziglang",
"cc", "-target", …]`` is one as well.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from .errors import BuildError
from .platforms import zig_compiler

# One rounding per operation, the same on every machine: no contraction, no instructions of this CPU only. Matrices of
# three by three are not vectorised: gcc 12 then waits for pairs to reach memory (17 to 20 ns a step instead of 8).
FLAGS = (
    *("-std=c11", "-O3", "-fno-tree-vectorize", "-falign-functions=32"),
    *("-ffp-contract=off", "-fvisibility=hidden", "-shared"),
)
VECTORISED = ("-ftree-vectorize",)  # for long rows instead
# What is left out of a structure is 0: a model's Switch may do without its last member.
WARNINGS = (
    *("-Wall", "-Wextra", "-Wno-missing-field-initializers", "-Wpedantic", "-Wconversion"),
    "-Werror=implicit-function-declaration",
)
SHOWN_ERRORS = 3  # of a compiler's many, the first few that the user can act on

_DIAGNOSTIC = re.compile(
    r"^(?P<file>.+?):(?P<line>\d+):(?:\d+:)? (?:fatal )?(?P<severity>error|note): (?P<text>.*?)(?: \[-W.*\])?$", re.M
)
_LINK_ERROR = re.compile(r"undefined (?:reference to|symbol:?) [`'\"]?_?(?P<name>\w+)")


def library_suffix(platform: str = sys.platform) -> str:
    """Return the suffix of a shared library: ``.so``, ``.dll`` or ``.dylib``."""
    return {"win32": ".dll", "darwin": ".dylib"}.get(platform, ".so")


def find_compiler() -> list[str]:
    """Return the command of the C compiler: ``$CC``, else the first of cc, gcc, clang on the path, else ziglang's.

    Raises
    ------
    BuildError
        There is none.
    """
    if words := shlex.split(os.environ.get("CC", "")):
        if shutil.which(words[0]):
            return words
        raise BuildError(f"the C compiler {words[0]!r} that $CC names is not found; correct or unset CC")
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    if zig := zig_compiler():
        return zig
    raise BuildError(
        "no C compiler found (cc, gcc, clang); install one, for example gcc, or the Python package ziglang,"
        " or name it in $CC"
    )


def fmi_headers() -> Path:
    """Return the folder of the FMI C headers, which the fmpy package carries.

    Raises
    ------
    BuildError
        fmpy is not installed.
    """
    spec = find_spec("fmpy")  # found, not imported: importing it costs 0.3 s
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (headers := Path(folder) / "c-code").is_dir():
            return headers
    raise BuildError("the FMI C headers are not found; install fmpy, which carries them")


def compile_library(
    source: Path,
    output: Path,
    *,
    include: Sequence[Path] = (),
    options: Sequence[str] = (),
    subject: Path | None = None,
    warnings_are_errors: bool = False,
    compiler: Sequence[str] | None = None,
    system: str = sys.platform,
) -> None:
    """Compile one C file to a shared library, written whole or not at all.

    Parameters
    ----------
    source : Path
        The C file, a complete translation unit.
    output : Path
        The library to write; its folder exists.
    include : sequence of Path
        Folders of headers and included sources, searched in this order.
    options : sequence of str
        Options that come after `FLAGS` and overrule them.
    subject : Path, optional
        The file in whose terms errors are reported, when it is not `source` itself.
    warnings_are_errors : bool
        Refuse what `WARNINGS` find.
    compiler : sequence of str, optional
        The compiler's command; by default `find_compiler`'s.
    system : str
        The operating system that the library is for, as `sys.platform` names it.

    Raises
    ------
    BuildError
        No compiler, or the source does not compile.
    """
    command = list(compiler or find_compiler())
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=".compile-") as folder:
        result = Path(folder) / output.name
        arguments = [
            *command,
            *FLAGS,
            *options,
            *_platform_flags(system),
            *WARNINGS,
            *(["-Werror"] if warnings_are_errors else []),
        ]
        arguments += [f"-I{path}" for path in include] + [str(source), "-o", str(result), *_libraries(system)]
        try:
            run = subprocess.run(
                arguments,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                env={**os.environ, "LC_ALL": "C"},
            )
        except OSError as error:
            raise BuildError(f"the C compiler {command[0]!r} cannot be run: {error.strerror}") from error
        if run.returncode != 0 or not result.is_file():
            raise BuildError(_explain(run.stderr, subject=subject or source))
        os.replace(result, output)


def _platform_flags(system: str) -> list[str]:
    if system == "win32":
        return ["-static-libgcc"] if sys.platform == "win32" else []
    return ["-fPIC"] if system == "darwin" else ["-fPIC", "-Wl,--no-undefined", "-Wl,--as-needed"]


def _libraries(system: str) -> list[str]:
    return [] if system == "win32" else ["-lm"]


def _explain(stderr: str, *, subject: Path) -> str:
    """Tell a compiler's output in terms of one file.

    Its own errors with their lines; where the first error is in another file, such as the expansion of its table, that
    one, with the line that led there.
    """
    found = list(_DIAGNOSTIC.finditer(stderr))
    own = [m for m in found if Path(m["file"]).name == subject.name]
    errors = [m for m in found if m["severity"] == "error"]
    if errors and errors[0] in own:
        faults = dict.fromkeys(f"line {m['line']}: {m['text']}" for m in errors if m in own)
        return f"{subject}: " + "; ".join(list(faults)[:SHOWN_ERRORS])
    if errors:
        place = f"{subject}: line {own[0]['line']}" if own else f"{subject}: it does not compile"
        return f"{place}: {errors[0]['text']}"
    if missing := dict.fromkeys(m["name"] for m in _LINK_ERROR.finditer(stderr)):
        return f"{subject}: it uses what it does not define: {', '.join(list(missing)[:SHOWN_ERRORS])}"
    lines = [line.strip() for line in stderr.splitlines() if line.strip()]
    return f"{subject}: it does not compile: {lines[-1] if lines else 'the compiler gave no reason'}"
