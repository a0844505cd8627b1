"""What mkdocs adds when it builds: keys of case files from the schema, public names from their docstrings, search."""

from __future__ import annotations

import inspect
import re
import shutil
from pathlib import Path
from typing import Any

import estimator
from estimator.cases.schema import schema


def on_files(files: Any, config: Any) -> Any:
    """Add the page that is generated."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, "case-file.md", content=case_file_page()))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Add the reference to the page on Python."""
    return markdown + api_reference() if page.file.src_uri == "api.md" else markdown


def on_post_build(config: Any) -> None:
    """Replace mkdocs' search, which needs a server, by one that reads its index from a disk as well."""
    folder = Path(config["site_dir"]) / "search"
    index = (folder / "search_index.json").read_text(encoding="utf-8")
    (folder / "search_index.js").write_text(f"window.searchIndex = {index};\n", encoding="utf-8")
    shutil.copyfile(Path(config["docs_dir"]) / "search.js", folder / "main.js")
    for name in ("search_index.json", "worker.js", "lunr.js"):
        (folder / name).unlink(missing_ok=True)


def case_file_page() -> str:
    """Return every key of a case file with what it takes, from the schema."""
    whole = schema()
    lines = ["# Case file", "", f"{whole.get('description', '')}".strip(), ""]
    lines += ["Made from the schema; `fmu-estimator schema` prints it for editors. Every key but the recording has a"]
    lines += ["default.", "", "| key | takes | what it is |", "|---|---|---|"]
    for key, entry in _keys(whole, ""):
        lines.append(f"| `{key}` | {_takes(entry)} | {_cell(entry.get('description', ''))} |")
    return "\n".join(lines) + "\n"


def _keys(node: dict[str, Any], path: str) -> list[tuple[str, dict[str, Any]]]:
    found = []
    for name, entry in node.get("properties", {}).items():
        found += _entry(f"{path}.{name}" if path else name, entry)
    for name in ("additionalProperties", *node.get("patternProperties", {})):
        entry = node.get(name) if name == "additionalProperties" else node["patternProperties"][name]
        if isinstance(entry, dict) and path:
            found += _entry(f"{path}.NAME", entry)
    return found


def _entry(path: str, entry: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    found = [(path, entry)]
    for part in (entry, *entry.get("anyOf", ()), *entry.get("oneOf", ())):
        found += _keys(part, path)
        if isinstance(part.get("items"), dict):
            found += _keys(part["items"], path)
    return list({key: (key, value) for key, value in reversed(found)}.values())[::-1]


def _takes(entry: dict[str, Any]) -> str:
    if "enum" in entry:
        return ", ".join(f"`{_cell(str(value))}`" for value in entry["enum"])
    if "const" in entry:
        return f"`{_cell(str(entry['const']))}`"
    parts = [_takes(part) for part in (*entry.get("anyOf", ()), *entry.get("oneOf", ()))]
    if parts:
        return " or ".join(dict.fromkeys(part for part in parts if part))
    kind = str(entry.get("type", ""))
    shown = {"object": "table", "string": "text", "integer": "whole number", "boolean": "true or false"}.get(kind, kind)
    limits = [f"{word} {entry[key]}" for key, word in LIMITS.items() if key in entry]
    default = [f"default `{_cell(str(entry['default']))}`"] if "default" in entry else []
    return ", ".join(part for part in (shown, *limits, *default) if part)


LIMITS = {"minimum": "at least", "maximum": "at most", "exclusiveMinimum": "above", "exclusiveMaximum": "below"}


def _cell(text: str) -> str:
    return re.sub(r"([|<>])", r"\\\1", text)


def api_reference() -> str:
    """Return signature and docstring of every public name."""
    lines = ["## Reference", ""]
    for name in estimator.__all__:
        thing = getattr(estimator, name)
        lines += [
            f"### {name}",
            "",
            "```text",
            _signature(name, thing),
            "```",
            "",
            "```text",
            inspect.getdoc(thing) or "",
        ]
        lines += ["```", ""]
        if name == "Result":
            for method, function in vars(thing).items():
                if not method.startswith("_") and inspect.getdoc(function):
                    first = (inspect.getdoc(function) or "").split("\n")[0]
                    lines.append(f"- `{method}`: {_cell(first)}")
            lines.append("")
    return "\n".join(lines)


def _signature(name: str, thing: Any) -> str:
    if inspect.isclass(thing):
        return f"class {name}"
    return f"{name}{inspect.signature(thing)}".replace("estimator.", "")
