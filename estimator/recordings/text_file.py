"""A text file's bytes → its text, however it is written. Knows no cell and no number."""

from __future__ import annotations

import codecs
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path

from estimator.errors import RecordingError
from estimator.recordings.suffixes import SUFFIXES

_MINUS = "\u2212"  # as spreadsheets write it in the north of Europe
_CONTROL = bytes(set(range(32)) - set(b"\t\n\v\f\r\x1a\x1b"))  # never in a text
_WORDS = (("时间", "gb18030"), ("時間", "big5"), ("時間", "shift_jis"), ("Время", "cp1251"), ("время", "cp1251"))
_TIMES = {word.encode(code): code for word, code in _WORDS}
_COMPRESSED = (b"\x1f\x8b", b"PK\3\4", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf", b"Rar!")
_HEAD = 4096  # bytes within which a word for the time tells how a Chinese, Japanese or Russian file is written


def read_text(path: Path) -> tuple[str, str]:
    """Return a file's text, its lines ended by line feeds, its minus signs hyphens, and how it is written."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise RecordingError(
            f"there is no recording {path}; give the path of a text file (CSV){_meant(path)}"
        ) from None
    except IsADirectoryError:
        raise RecordingError(f"{path} is a folder; give one of its files") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror or error}); make it readable") from None
    data = data.removeprefix(codecs.BOM_UTF8)
    encodings: tuple[str, ...] = ("utf-8", "latin-1")
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ("utf-16",)
    elif len(data := data.rstrip(b"\0")) != len(data.translate(None, _CONTROL)):
        if b"application/vnd.oasis.opendocument" in data[:_HEAD]:
            raise RecordingError(f"{path.name} is an OpenDocument file; save it as .xlsx or as CSV")
        if data.startswith(_COMPRESSED):
            raise RecordingError(f"{path.name} is compressed; unpack it, and give the file that was in it")
        raise RecordingError(f"{path.name} is not a text file; export the recording as CSV")
    encodings = (*(code for word, code in _TIMES.items() if word in data[:_HEAD]), *encodings)
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        text = text.replace(_MINUS, "-")
        return (text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text), encoding
    raise RecordingError(f"{path.name} begins as UTF-16 text and is none; export the recording as CSV in UTF-8")


def _meant(path: Path) -> str:
    """Return a question for who names a file that does not exist, where a recording beside it has nearly its name."""
    with suppress(OSError):
        beside = sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in SUFFIXES)
        same = [name for name in beside if Path(name).stem == path.name]
        stems = {Path(name).stem.lower(): name for name in beside}  # the ends of names are alike anyway
        for near in same or (stems[stem] for stem in get_close_matches(path.stem.lower(), stems, n=1)):
            return f"; did you mean {near}?"
    return ""
