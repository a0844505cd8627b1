"""An FMU as an archive: what it may hold before it is opened, and its extraction. Knows nothing of what is inside."""

from __future__ import annotations

import codecs
import re
import zipfile
from pathlib import Path, PurePosixPath

from estimator.errors import FmuError, one_line

MAX_MEMBERS = 20_000  # of the archive
MAX_SIZE = 4 * 2**30  # bytes, extracted
MAX_DESCRIPTION = 64 * 2**20  # bytes of modelDescription.xml
MAX_VARIABLES = 200_000  # of the description: some 4 s to read
MAX_ATTRIBUTE = 20_000  # characters of a name, or of any other attribute but a start value
MAX_RATIO = 1000  # of extracted to packed bytes: more is a bomb
SMALL = 2**24  # bytes: too small to be a bomb
ENCODINGS = ("utf-8", "utf8", "utf-16", "us-ascii", "ascii", "iso-8859", "latin", "windows-125", "cp125")  # of the XML


def check_archive(path: Path) -> None:
    """Raise FmuError unless the archive can be extracted without harm, and has a model description."""
    if not zipfile.is_zipfile(path):
        raise FmuError(f"{path.name} is no zip archive, so it is no FMU; give an .fmu file, or export it again")
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise FmuError(f"{path.name} is a damaged zip archive: {one_line(error)}") from error
    if len(members) > MAX_MEMBERS or sum(m.file_size for m in members) > MAX_SIZE:
        raise FmuError(f"{path.name} is too large: more than {MAX_MEMBERS} files or {MAX_SIZE >> 30} GiB extracted")
    for member in members:
        parts = PurePosixPath(member.filename).parts
        if member.filename.startswith("/") or ".." in parts or "\\" in member.filename or ":" in member.filename:
            raise FmuError(f"{path.name} holds the unsafe path {member.filename!r}; it is not opened")
        if "\0" in member.orig_filename:
            raise FmuError(f"{path.name} holds the unsafe path {member.orig_filename!r}; it is not opened")
        if member.flag_bits & 1:
            raise FmuError(f"{path.name} is encrypted ({member.filename!r}); export it without a password")
        if member.file_size > SMALL and member.file_size > MAX_RATIO * member.compress_size:
            raise FmuError(f"{path.name}: {member.filename!r} grows {MAX_RATIO} times when unpacked; it is not opened")
        if (member.external_attr >> 16) & 0o170000 == 0o120000:
            raise FmuError(f"{path.name} holds the symbolic link {member.filename!r}; it is not opened")
    names = [m.filename for m in members]
    if len(set(names)) < len(names):
        twice = next(n for n in names if names.count(n) > 1)
        raise FmuError(f"{path.name} holds {twice!r} twice; it is not opened")
    description = next((m for m in members if m.filename == "modelDescription.xml"), None)
    if description is None:
        raise FmuError(f"{path.name} has no modelDescription.xml, so it is no FMU")
    if description.file_size > MAX_DESCRIPTION:
        raise FmuError(f"{path.name}: modelDescription.xml is larger than {MAX_DESCRIPTION >> 20} MiB")


def check_description(path: Path) -> None:
    """Refuse a description with a document type: entities could expand without end, or reach files.

    Nor may it lack variables, be in an encoding in which a document type cannot be seen, or so large that reading it
    takes minutes.
    """
    with zipfile.ZipFile(path) as archive:
        text = archive.read("modelDescription.xml")
    if not text.strip():
        raise FmuError(f"{path.name}: modelDescription.xml is empty, so it is no FMU")
    declared = re.match(rb"""[^<]*<\?xml[^>]*?\bencoding\s*=\s*["']([^"']*)["']""", text.replace(b"\0", b"")[:300])
    encoding = declared[1].decode("ascii", "replace").lower() if declared else "utf-8"
    begins = text.lstrip(codecs.BOM_UTF8)[:200].replace(b"\0", b"").lstrip(codecs.BOM_UTF16_LE + codecs.BOM_UTF16_BE)
    if not encoding.startswith(ENCODINGS) or not begins.lstrip().startswith(b"<"):
        raise FmuError(f"{path.name}: modelDescription.xml is in the encoding {encoding!r}; write it in UTF-8")
    marks = ("<!DOCTYPE", "<!ENTITY")
    if any(mark.encode(code) in text for mark in marks for code in ("ascii", "utf-16-le", "utf-16-be")):
        raise FmuError(f"{path.name}: modelDescription.xml has a document type with entities; it is not opened")
    if b"\0" in text:  # UTF-16
        text = text.replace(b"\0", b"")
    if b"fmiVersion" not in text:
        raise FmuError(f"{path.name}: modelDescription.xml says no fmiVersion, so it is no FMU")
    if b"ModelVariables" not in text:
        raise FmuError(f"{path.name}: modelDescription.xml has no ModelVariables, so nothing of it can be estimated")
    variables = text.count(b"valueReference")
    if variables > MAX_VARIABLES:
        raise FmuError(
            f"{path.name}: modelDescription.xml has {variables} variables, more than {MAX_VARIABLES}; export the FMU"
            " without its protected and auxiliary variables"
        )
    long = re.search(rb"""\b(name|description|unit)\s*=\s*(?:"[^"]{%d}|'[^']{%d})""" % ((MAX_ATTRIBUTE,) * 2), text)
    if long:
        what = long[1].decode()
        raise FmuError(f"{path.name}: modelDescription.xml has a {what} of more than {MAX_ATTRIBUTE} characters")


def extract(path: Path, folder: Path) -> None:
    """Extract the FMU into an existing empty folder."""
    try:
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
    except Exception as error:  # zipfile and its decompressors raise many kinds
        raise FmuError(f"{path.name} cannot be extracted: {one_line(error)}") from error
