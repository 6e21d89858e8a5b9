"""Which way imports run: no arrow up, no circle, nothing heavy before it is needed."""

import ast
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = {path.stem: path for path in sorted((ROOT / "compact").glob("*.py"))}
# A module imports strictly lower levels only, so that no circle can close.
LEVELS = (
    (
        "refuse",
        "pieces",
        "measurements",
        "fitting",
        "deformation",
        "pressing",
        "equilibrium",
        "ringing",
        "pool",
        "criteria",
    ),
    (
        *("records", "material", "mesh", "patch", "plies", "sizing", "shaft", "follower", "variational", "results"),
        *("scene_errors", "polynomials", "quadratic", "lawspace", "pitch", "drawing", "page", "sobol", "springs"),
        *("pressed_memory", "strokes", "oscillator", "ranking", "ordering", "belt", "torque"),
    ),
    (
        *("laws", "halfplane", "dimensions", "modulation", "mix", "cart", "scene_rules", "streamline", "cap"),
        *("resisted", "limits", "imprint"),
    ),
    (
        *("kernel", "compliance", "stickslip", "confined", "judge", "reroll", "retained", "store", "scene_tables"),
        "suspended",
    ),
    ("fields", "solid", "expected", "bed", "turning", "flow", "optimise", "sliding"),
    ("frame", "march", "steady", "travelled", "filmed", "dynamics", "spectral"),
    ("compacted", "stiffening", "course"),
    ("compaction", "trip"),
    ("travelling",),
    ("motion", "contact", "fem", "drive", "scene", "column", "resistance"),
    ("memory", "measured", "cam", "crank", "passes", "spectral_modulation", "fem_modulation", "transient", "regime"),
    ("sprung_memory", "shaft_memory"),
    (
        *("contacts", "engine", "engineering", "elastic", "motor", "hydraulic", "made", "cutting", "cam_motion"),
        *("vary", "roller_motor"),
    ),
    ("mapping", "runup", "machine", "driven"),
    ("study", "calibrate", "cam_sheet"),
    ("figures", "published_laws", "published_machine", "cam_files", "sensitivity", "headline"),
    ("contact_report", "drive_report", "published", "maps", "sweep", "order_figures"),
    ("beside_report",),
    ("checks", "html_answer", "html_contact", "sweep_report"),
    ("html_machine",),
    ("html_report",),
    ("report",),
    ("cli",),
    ("__init__",),
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
    assert arrows_up("drive", {"cart", "motion", "study"}) == {"drive -> motion", "drive -> study"}
