"""The arrows between the modules point one way: `estimator` is layered, `fmu_build` knows nothing of it."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def imports(path):
    """Return the modules of this project that a module imports, at any depth of indentation."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if name.split(".")[0] in ("estimator", "fmu_build", "fmpy")}


def modules(package):
    return {path.stem: path for path in (ROOT / package).glob("*.py")}


def test_no_module_is_imported_in_a_circle():
    known = modules("estimator")
    arrows = {
        name: {i.split(".")[1] for i in imports(path) if i.startswith("estimator.") and i.split(".")[1] in known}
        for name, path in known.items()
    }
    remaining = dict(arrows)
    while remaining:
        free = [name for name, below in remaining.items() if not (below - {name}) & set(remaining)]
        assert free, f"these modules import each other in a circle: {sorted(remaining)}"
        for name in free:
            del remaining[name]


def test_fmu_build_never_imports_estimator():
    for path in modules("fmu_build").values():
        assert not [i for i in imports(path) if i.startswith("estimator")], path


def test_only_the_fmu_modules_know_fmpy():
    allowed = {"fmu", "slave", "foreign", "exchange"}
    users = {name for name, path in modules("estimator").items() if any(i.startswith("fmpy") for i in imports(path))}
    assert users <= allowed


def test_the_search_knows_neither_motor_nor_fmu():
    for name in ("cuckoo", "search"):
        below = {i for i in imports(modules("estimator")[name]) if i.startswith("estimator.")}
        assert {i.split(".")[1] for i in below} <= {"cuckoo"}
