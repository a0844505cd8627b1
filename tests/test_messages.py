"""Every failure message of the program, found in its source, says what to do next.

`pytest tests/test_messages.py -s -k list` prints them all.
"""

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ERRORS = {
    "InputError", "RecordingError", "CaseError", "FmuError", "SimulationError", "BuildError", "DiskError",
    "ClusterError", "ArgumentTypeError",
}  # fmt: skip
NEXT = re.compile(
    r"\b(give|use|take|set|say|see|record|widen|leave|name|write|rename|install|pip install|check|make|choose|export"
    r"|build|run|add|start|sample|spell|remove|put|replace|repeat|fix|free|shorten|close|look|ask|pick|quote|mark|keep"
    r"|go on|try|save|split|convert|extract|wait|did you mean|needs?|must|should|only|expected|not on one"
    r"|has to|at least|between|such as|without|instead|end(s|ing) in|goes with|comes? from|takes?"
    r"|either|there are|2 or 3 is|cannot be estimated|unit)\b"
)

# What the system or another program says is passed on; it is the reason, and the remedy lies there.
REASON_IS_ENOUGH = (
    r"the bundled model \{text\} cannot be built: \{error\}",
    r"\{self._name\} cannot be loaded: .*",
    r".*'the FMU crashed'.*",
    r"the compiled library cannot be loaded: .*",
    r"the C compiler .* is not found; correct or unset CC",
    r"the compiler's output is no macOS library of 64 bits",
    r"\{target\}: (there is no folder|cannot be written).*",
    r"\{source\}: (the model file cannot be read|a model is one file).*",
)


def template(node: ast.expr) -> str:
    """Return a message with its values as {…}."""
    if isinstance(node, ast.Constant):
        return str(node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(template(part) for part in node.values)
    if isinstance(node, ast.FormattedValue):
        return "{" + ast.unparse(node.value) + "}"
    if isinstance(node, ast.BinOp):
        return template(node.left) + template(node.right)
    return "{" + ast.unparse(node) + "}"


@cache
def messages():
    """Return (place, message) of every error that is raised on purpose."""
    found = []
    for path in sorted([*(ROOT / "estimator").rglob("*.py"), *(ROOT / "fmu_build").glob("*.py")]):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Call)
                and node.args
                and getattr(node.func, "id", getattr(node.func, "attr", "")) in ERRORS
            ):
                found.append((f"{path.name}:{node.lineno}", template(node.args[0])))
    return found


def tells_what_to_do(message: str) -> bool:
    """Whether a message names a remedy, shows what there is to choose from, or is passed on from where it was made."""
    if any(re.fullmatch(reason, message) for reason in REASON_IS_ENOUGH):
        return True
    passed_on = not re.sub(r"\{.*?\}", "", message).strip(" :;,.'\"")
    choices = (
        "suggestion(" in message
        or "how_to_map(" in message
        or re.search(r"\(\{[^()]*(\([^()]*\))?[^()]*\}\)$", message)
    )
    return passed_on or bool(NEXT.search(message)) or bool(choices)


def test_all_messages_are_found_and_listed():
    found = messages()
    print(*(f"{place}  {message}" for place, message in found), sep="\n")
    assert len(found) > 150
    assert all(any(re.fullmatch(reason, m) for _, m in found) for reason in REASON_IS_ENOUGH), "one has gone: forget it"


def test_every_message_says_what_to_do_next():
    assert [(place, message) for place, message in messages() if not tells_what_to_do(message)] == []
