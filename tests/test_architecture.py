"""The arrows between the modules and between the folders point one way; `fmu_build` knows nothing of `estimator`."""

import ast
import gc
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "estimator"
ROOMS = sorted(path.parent.name for path in PACKAGE.glob("*/__init__.py"))
OUTSIDE = ("fmpy", "ctypes")


@pytest.fixture(scope="module", autouse=True)
def syntax_trees():
    """Half a million nodes are held for these tests alone; a collector would go through them again and again."""
    gc.disable()
    yield
    nodes.cache_clear()
    gc.enable()


def name_of(path):
    """Return the dotted name of a module of this project."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def modules(package):
    return {name_of(path): path for path in (ROOT / package).rglob("*.py")}


@cache
def nodes(path):
    """Return all nodes of a module's syntax tree, the module itself first."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def imports(path):
    """Return what a module imports, at any depth of indentation: this project's modules, and what few may know."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {name for name in found if name.split(".")[0] in ("estimator", "fmu_build", *OUTSIDE)}


@cache
def arrows():
    """Return for every module of `estimator` the modules that it imports."""
    known = modules("estimator")
    folders = {"estimator", *(f"estimator.{room}" for room in ROOMS)}
    return {name: (imports(path) & set(known)) - {name} - folders for name, path in known.items()}


def room_of(module):
    """Return a module's folder; the few modules beside the folders are each a room of its own."""
    return ".".join(module.split(".")[:2])


@cache
def arrows_between_rooms():
    found = {room_of(name): set() for name in arrows()}
    for name, below in arrows().items():
        found[room_of(name)] |= {room_of(other) for other in below} - {room_of(name)}
    return found


def circle(graph):
    """Return what is left when all is taken away that needs nothing of the rest: the circles and what needs them."""
    remaining = dict(graph)
    while free := [name for name, below in remaining.items() if not below & set(remaining)]:
        for name in free:
            del remaining[name]
    return sorted(remaining)


def test_no_module_is_imported_in_a_circle():
    assert len(arrows()) > 100 and not circle(arrows())


def test_no_folder_is_imported_in_a_circle():
    assert len(ROOMS) > 5 and not circle(arrows_between_rooms())


def test_the_map_of_the_folders_says_what_each_says_of_itself_from_the_top_down():
    page = (ROOT / "docs" / "structure.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)/` \| (.+) \|$", page, re.M)
    assert sorted(room for room, _ in rows) == ROOMS
    for room, words in rows:
        assert words == ast.get_docstring(ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")))
    below = [f"estimator.{room}" for room, _ in rows]
    for k, room in enumerate(below):
        assert not arrows_between_rooms()[room] & set(below[:k]), f"{room} stands below a folder that it imports"


def test_the_map_names_each_module_of_the_engine():
    page = (ROOT / "docs" / "structure.md").read_text(encoding="utf-8")
    paths = [path for room in ("noise", "fitting", "explaining") for path in (PACKAGE / room).glob("[a-z]*.py")]
    assert len(paths) > 50 and [path.name for path in paths if f"{path.name}`" not in page] == []


@pytest.mark.parametrize("room", ROOMS)
def test_a_folder_holds_its_modules_and_no_second_door_to_them(room):
    (only,) = ast.parse((PACKAGE / room / "__init__.py").read_text(encoding="utf-8")).body
    assert isinstance(only, ast.Expr), "its docstring alone"


def test_fmu_build_never_imports_estimator():
    for path in modules("fmu_build").values():
        assert not [i for i in imports(path) if i.startswith("estimator")], path


def named(node):
    """Return the name that an expression reads: x, or "x" of values["x"]."""
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        return node.slice.value
    return node.id if isinstance(node, ast.Name) else None


def motor_formulas(path):
    """Return the lines of a module that list the motor's five parameters, or multiply or divide two of them."""
    found = []
    for node in nodes(path):
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            values = [e.value for e in node.elts if isinstance(e, ast.Constant)]
            found += [node.lineno] * (set("RKLJB") <= {v for v in values if isinstance(v, str)})
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
            inner = node.left.right if isinstance(node.left, ast.BinOp) else node.left
            found += [node.lineno] * ({named(inner), named(node.right)} <= set("RKLJB"))
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
            found += [node.lineno] * (named(node.left) in set("RKLJB"))
    return found


def test_only_the_motors_folder_knows_its_equations():
    formulas = {name: lines for name, path in modules("estimator").items() if (lines := motor_formulas(path))}
    assert {room_of(name) for name in formulas} == {"estimator.motor"} and len(formulas) >= 4


def lookups(path):
    """Return the lines of a module that look a name up in an FMU's table of variables."""
    found = [n for n in nodes(path) if isinstance(n, ast.Attribute)]
    called = [n for n in found if isinstance(n.value, ast.Name | ast.Attribute)]
    tables = [n for n in called if getattr(n.value, "id", getattr(n.value, "attr", "")) == "description"]
    return [n.lineno for n in tables if n.attr in ("variable", "variables", "of_causality")]


def test_the_names_of_a_case_are_resolved_in_one_place():
    rooms = [f"estimator.{room}" for room in ("plans", "noise", "fitting", "explaining", "judging", "estimating")]
    assert {m for m, p in modules("estimator").items() if room_of(m) in rooms and lookups(p)} == {
        "estimator.plans.binding"
    }


def users(library):
    return {
        name for name, path in modules("estimator").items() if any(i.split(".")[0] == library for i in imports(path))
    }


def test_only_the_fmu_modules_know_fmpy():
    allowed = {
        "fmus.fmu",
        "stepping.slow_path",
        "stepping.model_exchange",
        "stepping.equations",
    }
    assert users("fmpy") == {f"estimator.{name}" for name in allowed}


def test_only_a_worker_process_loads_a_library_but_for_the_whitening_filter():
    assert {room_of(name) for name in users("ctypes") - {"estimator.noise.kalman"}} == {"estimator.stepping"}


def test_the_search_knows_neither_motor_nor_fmu():
    search, cuckoo = "estimator.estimating.search", "estimator.estimating.cuckoo"
    optimiser = "estimator.estimating.optimiser"
    assert arrows()[optimiser] == set() and arrows()[cuckoo] == arrows()[search] == {optimiser}


def test_a_statistical_convention_is_defined_once():
    names = {target.id for target in assigned(PACKAGE / "conventions.py")}
    assert {"MEDIAN_SIZE", "FALSE_ALARM"} <= names
    again = {
        f"{path.relative_to(ROOT)}: {target.id}"
        for path in modules("estimator").values()
        if path.name != "conventions.py"
        for target in assigned(path)
        if target.id in names
    }
    assert not again, "import it from estimator/conventions.py, or give what is another thing another name"


def assigned(path):
    """Return the names that a module gives values to at its top."""
    statements = nodes(path)[0].body
    targets = [target for s in statements if isinstance(s, ast.Assign) for target in s.targets]
    return [name for target in targets for name in getattr(target, "elts", [target]) if isinstance(name, ast.Name)]
