"""Which way imports run: no arrow up, no circle, nothing heavy before it is needed, no name for two things."""

import ast
import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from pkgutil import resolve_name

import pytest

ROOT = Path(__file__).parents[1]
MODULES = {path.stem: path for path in sorted((ROOT / "compact").glob("*.py"))}
# A module imports strictly lower levels only, so that no circle can close.
LEVELS = (
    (
        "refuse",
        "failures",
        "capabilities",
        "pieces",
        "assembly",
        "measurements",
        "fitting",
        "deformation",
        "pressing",
        "equilibrium",
        "heaping",
        "ringing",
        "pool",
        "criteria",
        "progress",
        "stage_costs",
    ),
    (
        *("records", "material", "mesh", "patch", "plies", "sizing", "shaft", "follower", "variational", "results"),
        *("scene_errors", "polynomials", "quadratic", "lawspace", "pitch", "drawing", "page", "sobol", "springs"),
        *("strokes", "oscillator", "ranking", "belt", "torque"),
    ),
    (
        *("laws", "halfplane", "dimensions", "modulation", "mix", "cart", "scene_rules", "streamline", "cap"),
        *("resisted", "limits", "ordering"),
    ),
    (
        *("kernel", "compliance", "stickslip", "confined", "judge", "reroll", "retained", "store", "scene_tables"),
        "suspended",
    ),
    ("plausible", "fields", "solid", "expected", "bed", "turning", "flow", "sequential_programming", "sliding"),
    ("frame", "march", "steady", "travelled", "filmed", "dynamics", "spectral"),
    ("compacted", "stiffening", "course"),
    ("compaction", "trip"),
    ("travelling",),
    ("motion", "contact", "fem_engine", "rigid_drive", "scene", "column", "resistance"),
    ("measured", "cam", "crank", "passes", "spectral_modulation", "fem_modulation", "transient", "regime"),
    (
        *("contacts", "engine", "engineering", "elastic", "motor", "hydraulic", "made", "cutting", "cam_motion"),
        *("vary", "roller_motor", "fem"),
    ),
    ("mapping", "runup", "machine", "driven", "drive"),
    ("study", "calibrate", "cam_sheet"),
    ("figures", "published_laws", "published_machine", "cam_files", "sensitivity", "headline"),
    ("contact_report", "drive_report", "published", "maps", "sweep", "order_figures"),
    ("beside_report",),
    ("checks", "html_answer", "html_contact", "sweep_report"),
    ("html_machine",),
    ("html_report",),
    ("report",),
    ("cli",),
    ("__init__", "__main__"),
)
LEVEL = {module: level for level, modules in enumerate(LEVELS) for module in modules}
# They meet in a study, through plain callables.
SIBLINGS = ("contact", "drive", "motion", "mix", "material", "mesh")
DRAWING = ("figures", "order_figures", "maps")
HEAVY = ("numpy", "scipy", "matplotlib", "pydantic")


def imported(tree):
    """Full names of all that a tree imports, wherever: `from compact import x` gives compact.x."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = "." * node.level + (node.module or "")
            yield start
            yield from (f"{start}.{alias.name}" for alias in node.names)


def at_start_up(tree):
    """The same for what runs when the module is imported: not inside functions."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from imported(ast.Module([node], []))
        else:
            yield from at_start_up(node)


@cache
def tree_of(module):
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


def ours(names):
    """Modules of `compact` among the names."""
    return {name.split(".")[1] for name in names if name.startswith("compact.") and name.split(".")[1] in MODULES}


def packages(names):
    return {name.split(".")[0] for name in names}


def arrows_up(module, targets):
    return {f"{module} -> {target}" for target in targets if LEVEL.get(target, len(LEVELS)) >= LEVEL[module]}


@pytest.mark.parametrize("module", MODULES)
def test_module_has_its_place(module):
    assert module in LEVEL, f"place compact/{module}.py in LEVELS of tests/test_imports.py, above all that it imports"


def test_no_module_has_two_places():
    assert len(LEVEL) == sum(len(modules) for modules in LEVELS)


@pytest.mark.parametrize("module", [module for module in MODULES if module in LEVEL])
def test_no_arrow_runs_up(module):
    assert arrows_up(module, ours(imported(tree_of(module)))) == set()


@pytest.mark.parametrize("module", MODULES)
def test_modules_are_named_in_full(module):
    """Neither relative imports nor names by way of the package, which would hide an arrow."""
    names = set(imported(tree_of(module)))
    hidden = {name for name in names if name.startswith("compact.") and name.split(".")[1] not in MODULES}
    assert {name for name in names if name.startswith(".")} | hidden == set()


@pytest.mark.parametrize("module", [module for module in SIBLINGS if module in MODULES])
def test_siblings_do_not_know_one_another(module):
    assert ours(imported(tree_of(module))) & set(SIBLINGS) == set()


@pytest.mark.parametrize("module", MODULES)
def test_package_knows_neither_studies_nor_tests(module):
    assert packages(imported(tree_of(module))).isdisjoint({"studies", "tests", "pytest", "hypothesis", "mpmath"})


@pytest.mark.parametrize("module", [module for module in MODULES if module not in DRAWING])
def test_only_figures_and_maps_draw(module):
    assert "matplotlib" not in packages(imported(tree_of(module)))


@pytest.mark.parametrize("module", MODULES)
def test_figures_are_imported_where_they_are_drawn(module):
    drawing = set() if module in DRAWING else set(DRAWING)
    assert ours(at_start_up(tree_of(module))).isdisjoint(drawing)


@pytest.mark.parametrize("module", ["compact", "compact.cli"])
def test_start_up_loads_nothing_heavy(module):
    script = f"import sys, {module}; print(*sorted(set({HEAVY}) & set(sys.modules)))"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


# names


def exported(tree):
    """Names of `__all__`, and keys of the table of lazy names of the package."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", None) in ("__all__", "_HOMES"):
            value = node.value.values if isinstance(node.value, ast.Dict) else [node.value]
            yield from (leaf.value for one in value for leaf in ast.walk(one) if isinstance(leaf, ast.Constant))


PACKAGES = sorted((ROOT / "compact").rglob("__init__.py"))


@pytest.mark.parametrize("door", PACKAGES, ids=lambda door: door.parent.name)
def test_no_package_exports_the_name_of_a_module_of_its_own(door):
    """Import of the module would put it in place of what the package exports."""
    modules = {path.stem for path in [*door.parent.glob("*.py"), *door.parent.glob("*/__init__.py")]}
    names = set(exported(ast.parse(door.read_text(encoding="utf-8"))))
    assert names & modules == set()
    assert names or door.parent.name != "compact"


IMPORT_ALL = """
import importlib, pkgutil, sys
import compact

def exported():
    doors = [compact, *(importlib.import_module(f"compact.{door}") for door in sys.argv[1:])]
    return {f"{door.__name__}.{name}": getattr(door, name) for door in doors for name in door.__all__}

before = exported()
for module in pkgutil.iter_modules(compact.__path__):
    importlib.import_module(f"compact.{module.name}")
after = exported()
print(len(after), *(name for name in after if after[name] is not before[name] or type(after[name]) is type(sys)))
"""


def test_import_of_every_module_leaves_every_exported_name_the_same_object():
    doors = [module for module in MODULES if module != "__init__" and list(exported(tree_of(module)))]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    call = [sys.executable, "-c", IMPORT_ALL, *doors]
    done = subprocess.run(call, cwd=ROOT, env=environment, capture_output=True, text=True, check=True)
    count, *moved = done.stdout.split()
    assert moved == []
    assert int(count) > 100


def lazy(tree):
    """Names of ours that are imported by a string, such as "compact.fem_engine"."""
    for node in ast.walk(tree):
        name = node.value if isinstance(node, ast.Constant) else None
        if isinstance(name, str) and re.fullmatch(r"compact(\.[a-z_]+)+", name):
            yield name


def test_names_imported_by_a_string_are_there():
    names = {name for module in MODULES for name in lazy(tree_of(module))}
    assert {"compact.fem_engine", "compact.fem_modulation"} <= names
    for name in names:
        resolve_name(name)


# the reader of imports itself


def test_reader_finds_imports_of_every_form():
    source = "import a.b, c as d\nfrom compact import x\nfrom . import y\ndef f():\n    from compact.z import w\n"
    names = set(imported(ast.parse(source)))
    assert {"a.b", "c", "compact.x", "..y", "compact.z", "compact.z.w"} <= names
    assert set(at_start_up(ast.parse(source))) == names - {"compact.z", "compact.z.w"}


def test_reader_looks_into_classes_and_conditions():
    source = "class A:\n    import a\nif A:\n    import b\ntry:\n    import c\nexcept ImportError:\n    import d\n"
    assert set(at_start_up(ast.parse(source))) == {"a", "b", "c", "d"}


def test_arrow_up_is_found():
    assert arrows_up("rigid_drive", {"cart", "motion", "study"}) == {"rigid_drive -> motion", "rigid_drive -> study"}
