"""The bundled models' FMUs: built at install, built again where that is out of date. Knows where they are kept."""

from __future__ import annotations

import os
import re
import sys
import zipfile
from pathlib import Path

from .errors import BuildError
from .platforms import platform_folder
from .sources import HERE, bundled_sources, fmu_sources

BUNDLED = HERE / "bundled"


def bundled_names() -> tuple[str, ...]:
    """Return the names of the bundled models."""
    return tuple(bundled_sources())


def bundled(name: str) -> Path:
    """Return the path of a bundled model's FMU, which is built first if it is missing or out of date.

    It lies in the package; where that cannot be written, in the user's cache.

    Raises
    ------
    BuildError
        There is no such model, or it cannot be built.
    """
    sources = bundled_sources()
    if name not in sources:
        raise BuildError(f"no bundled model {name!r} ({', '.join(sources)})")
    guid = fmu_sources(sources[name])[1]
    places = [BUNDLED / f"{name}.fmu", _cache() / guid.strip("{}") / f"{name}.fmu"]
    for place in places:
        if _is_current(place, guid):
            return place
    for place in places:
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(place.parent, os.W_OK):
            from .export import build  # which the current ones do not need

            return build(name, output=place)
    raise BuildError(
        f"the FMU of {name} cannot be kept: neither {places[0].parent} nor {places[1].parent} can be written"
    )


def _is_current(fmu: Path, guid: str) -> bool:
    """Return whether there is such an FMU, with this GUID and a binary for this machine."""
    try:
        with zipfile.ZipFile(fmu) as archive:
            folders = {name.rpartition("/")[0] for name in archive.namelist()}
            match = re.search(rb'guid="(.*?)"', archive.read("modelDescription.xml"))
    except (OSError, KeyError, zipfile.BadZipFile):
        return False
    return match is not None and match[1].decode() == guid and f"binaries/{platform_folder()}" in folders


def _cache() -> Path:
    """Return this user's cache folder of the package."""
    if sys.platform == "win32":
        root = os.environ.get("LOCALAPPDATA") or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        root = str(Path.home() / "Library" / "Caches")
    else:
        root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "fmu-estimator"
