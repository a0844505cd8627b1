"""A model file to an FMU: compile, read back, describe, pack. Knows the layout of an FMU's archive."""

from __future__ import annotations

import contextlib
import os
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from .checks import check_model, dependencies
from .compiler import compile_library, fmi_headers, library_suffix
from .description import build_description, model_description
from .documentation import header_comment, icon, index_page, summary
from .errors import BuildError
from .model import loaded_model
from .platforms import Platform, find_platforms, platform_folder, universal_binary, zig_compiler
from .sources import GLUE, beside, find_source, fmu_sources, unit_name

_LICENCE_NOTE = """\
The code around the model (model.h, integrator.c, regime.c, modes.c, instance.c, sensitivity.c, fmi.c, fmi2.c, fmi3.c)
is under the licence below. The model itself is its author's.

"""


def build(
    model: str | Path, *, output: Path | None = None, fmi: int = 2, platforms: Sequence[str] | None = None
) -> Path:
    """Build an FMU for co-simulation and model exchange.

    Parameters
    ----------
    model : str or Path
        A bundled model's name, or the path of a model file (see model.h).
    output : Path, optional
        The FMU to write, whole or not at all; by default ``<model>.fmu`` in the current folder.
    fmi : int
        The version of FMI: 2 or 3.
    platforms : sequence of str, optional
        Names of `PLATFORMS` to compile for, with the ziglang package; by default this machine, with its C compiler.

    Returns
    -------
    Path
        The FMU.

    Raises
    ------
    BuildError
        One sentence: no such model, no compiler, a fault of the model, a file that cannot be written.
    """
    if fmi not in GLUE:
        raise BuildError(f"FMI {fmi} is not offered; 2 or 3 is")
    source = find_source(model)
    wanted = find_platforms(platforms) if platforms is not None else None
    target = output or Path(f"{source.stem}.fmu")
    if not target.parent.is_dir():
        raise BuildError(f"{target}: there is no folder {target.parent}")
    files, guid = fmu_sources(source, fmi=fmi)
    with tempfile.TemporaryDirectory(prefix="fmu_build-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_bytes(text)
        library = folder / f"{source.stem}{library_suffix()}"  # the table is read from it
        compile_library(folder / unit_name(source), library, include=[fmi_headers()], subject=source)
        with loaded_model(library, source=source) as (table, equations):
            check_model(table, equations, source=source)
            written = files[source.name].decode()
            changed_by = dependencies(table, equations, text=written, source=source)
        header = header_comment(written)
        description = model_description(
            table,
            fmi=fmi,
            guid=guid,
            description=summary(header),
            dependencies=changed_by,
            source_file=unit_name(source),
        )
        content = {
            "modelDescription.xml": description,
            "model.png": icon(),
            "documentation/index.html": index_page(table, header=header),
            "documentation/licenses/license.txt": _LICENCE_NOTE.encode() + beside("LICENSE").read_bytes(),
        }
        if wanted is None:
            content[f"binaries/{platform_folder(fmi)}/{library.name}"] = library.read_bytes()
        else:
            content |= _binaries(folder / unit_name(source), wanted, fmi=fmi, source=source)
        if fmi == 3:
            content["sources/buildDescription.xml"] = build_description(table.name, source_file=unit_name(source))
        content |= {f"sources/{file}": files[file] for file in sorted(files)}
    _write_archive(target, content)
    return target


def _binaries(unit: Path, platforms: Sequence[Platform], *, fmi: int, source: Path) -> dict[str, bytes]:
    """Compile for other platforms; return the libraries by their names in the archive."""
    slices: dict[str, list[bytes]] = {}
    for platform in platforms:
        compiler = zig_compiler(platform.target)
        if compiler is None:
            raise BuildError("other platforms are compiled for by zig; install the Python package ziglang")
        library = unit.parent / f"for-{platform.name}" / f"{source.stem}{platform.suffix}"
        library.parent.mkdir()
        compile_library(
            unit, library, include=[fmi_headers()], subject=source, compiler=compiler, system=platform.system
        )
        folder = platform.folder if fmi == 2 else platform.tuple
        slices.setdefault(f"binaries/{folder}/{library.name}", []).append(library.read_bytes())
    return {name: found[0] if len(found) == 1 else universal_binary(found) for name, found in slices.items()}


def _write_archive(target: Path, content: Mapping[str, bytes]) -> None:
    """Write a zip archive, the same bytes for the same content, whole or not at all."""
    temporary = target.with_name(f".{target.name}-{uuid.uuid4().hex}")
    try:
        with zipfile.ZipFile(temporary, "x", zipfile.ZIP_DEFLATED) as archive:
            for name, data in content.items():
                entry = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                entry.external_attr = (0o755 if name.startswith("binaries/") else 0o644) << 16
                archive.writestr(entry, data)
        os.replace(temporary, target)
    except OSError as error:
        with contextlib.suppress(OSError):  # on a disk that cannot be written, not even that
            temporary.unlink(missing_ok=True)
        raise BuildError(f"{target}: cannot be written: {error.strerror}") from error
