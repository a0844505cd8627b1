"""A model's page and icon inside its FMU. Knows the table and the model file's header comment."""

from __future__ import annotations

import html
import re
import struct
import zlib

from .model import Model

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{name}</title>
<style>
body {{ font-family: sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; }}
table {{ border-collapse: collapse; }}
th, td {{ border-bottom: 1px solid #ccc; padding: 0.3em 0.8em; text-align: left; }}
</style>
</head>
<body>
<h1>{name}</h1>
<pre>{header}</pre>
<table>
<tr><th>Name</th><th>Kind</th><th>Start</th><th>Min</th><th>Max</th><th>Unit</th><th>Description</th></tr>
{rows}
</table>
<p>Inputs are held over a communication step. Parameters may be changed before the simulation and between steps. Any
positive communication step may be used, and it may vary; {steps}</p>
</body>
</html>
"""


def header_comment(source: str) -> str:
    """Return the text of a C file's first comment, without its frame."""
    match = re.match(r"\s*/\*(.*?)\*/", source, re.S)
    lines = [re.sub(r"^ ?\* ?", "", line).rstrip() for line in match[1].splitlines()] if match else []
    return "\n".join(lines).strip()


def summary(header: str) -> str:
    """Return the first sentence of a header comment, on one line."""
    paragraph = " ".join(header.split("\n\n")[0].split())
    return re.split(r"(?<=[.!?])\s", paragraph)[0].rstrip(".:")


def index_page(model: Model, *, header: str) -> bytes:
    """Return documentation/index.html: the header comment, the variables, what may be done with them."""
    rows = []
    for v in model.variables:
        start = "" if v.kind in ("output", "mode") else f"{v.start:g}"
        kind = {"state": "output, integrated", "output": "output, calculated", "mode": "mode, found"}.get(
            v.kind, v.kind
        )
        cells = (v.name, kind, start, f"{v.min:g}", f"{v.max:g}", v.unit, v.description)
        rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
    steps = (
        "the response to held inputs is exact at any."
        if model.linear
        else "substeps keep the integration error to about 1e-10 of each state."
    )
    page = _PAGE.format(name=html.escape(model.name), header=html.escape(header), rows="\n".join(rows), steps=steps)
    return page.encode()


def icon(size: int = 64) -> bytes:
    """Return a PNG of the circuit symbol of a motor, an M in a circle, grey with an alpha channel."""
    strokes = [((0.34, 0.68), (0.34, 0.34)), ((0.34, 0.34), (0.5, 0.56))]
    strokes += [((0.5, 0.56), (0.66, 0.34)), ((0.66, 0.34), (0.66, 0.68))]
    rows = b""
    for row in range(size):
        rows += b"\0"
        for column in range(size):
            x, y = (column + 0.5) / size, (row + 0.5) / size
            distance = abs(((x - 0.5) ** 2 + (y - 0.5) ** 2) ** 0.5 - 0.44)
            for (x0, y0), (x1, y1) in strokes:
                along = ((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2)
                along = min(max(along, 0), 1)
                distance = min(distance, ((x - x0 - along * (x1 - x0)) ** 2 + (y - y0 - along * (y1 - y0)) ** 2) ** 0.5)
            alpha = min(max((0.03 - distance) * size + 0.5, 0), 1)
            rows += bytes((48, round(255 * alpha)))
    header = struct.pack(">IIBBBBB", size, size, 8, 4, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
