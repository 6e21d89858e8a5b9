"""Draw the packages of `compact` on their layers, with arrows for the imports between them.

An arrow that a chain of other arrows implies is left out.

    python docs/draw_architecture.py

The layers come from `pyproject.toml`, the imports from the code. The drawing is `docs/figures/architecture.png`.
"""

import tomllib
from collections import Counter
from pathlib import Path

import grimp
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch

ROOT = Path(__file__).parents[1]
WIDTH, HEIGHT = 11.0, 8.2  # [inch], of the drawing
RESOLUTION = 110  # [1/inch]
CONTRACT = "Layers: a module imports lower layers only"


def layers() -> list[list[str]]:
    """Return the units of each layer, the highest layer first."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    (found,) = [contract["layers"] for contract in contracts if contract["name"] == CONTRACT]
    return [[unit.strip() for unit in layer.split("|")] for layer in found if layer != "__main__"]


def imports() -> Counter[tuple[str, str]]:
    """Count the imports between units, a package or a module directly below `compact`."""
    graph, counts = grimp.build_graph("compact", exclude_type_checking_imports=True), Counter()
    for module in graph.modules:
        for target in graph.find_modules_directly_imported_by(module):
            pair = tuple(name.split(".")[1] if "." in name else "" for name in (module, target))
            if all(pair) and pair[0] != pair[1] and "__main__" not in pair:
                counts[pair] += 1
    return counts


def reduced(pairs: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """Remove the pairs that a chain of other pairs implies."""
    below = {source: {b for a, b in pairs if a == source} for source, _ in pairs}

    def reach(unit: str) -> set[str]:
        return {unit}.union(*(reach(next_unit) for next_unit in below.get(unit, ())))

    return {
        (source, target)
        for source, target in pairs
        if not any(target in reach(other) for other in below[source] - {target})
    }


def sizes() -> dict[str, tuple[int, int]]:
    """Count the modules and lines of each unit."""
    found = {}
    for unit in {unit for layer in layers() for unit in layer}:
        path = ROOT / "compact" / unit
        files = sorted(path.rglob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
        found[unit] = len(files), sum(len(file.read_text("utf-8").splitlines()) for file in files)
    return found


def draw() -> Figure:
    """Draw all units and imports."""
    rows, counts, lines = layers(), imports(), sizes()
    figure = Figure(figsize=(WIDTH, HEIGHT), dpi=RESOLUTION)
    ax = figure.add_axes((0.01, 0.01, 0.98, 0.92), xlim=(0, 1), ylim=(-0.5, len(rows) - 0.5))
    ax.set_axis_off()
    ax.set_title("Packages of compact: every import points down; arrows implied by others are left out")
    place, boxes = {}, {}
    for level, units in enumerate(reversed(rows)):
        for number, unit in enumerate(units):
            place[unit] = x, y = (number + 0.5 + 0.12 * (-1) ** level) / len(units), level
            modules, count = lines[unit]
            size = f"{modules} modules, {count} lines" if modules > 1 else f"{count} lines"
            box = {"boxstyle": "round,pad=0.45", "facecolor": "#eef3f8", "edgecolor": "#41627f"}
            shown = ax.text(x, y, f"{unit}\n{size}", ha="center", va="center", fontsize=9, bbox=box, zorder=3)
            boxes[unit] = shown.get_bbox_patch()
    figure.draw_without_rendering()  # sets the boxes, at whose edges the arrows end
    for source, target in sorted(reduced(set(counts))):
        (x0, y0), (x1, y1) = place[source], place[target]
        ax.add_patch(FancyArrowPatch(
            (x0, y0), (x1, y1), arrowstyle="-|>", mutation_scale=10, shrinkA=1, shrinkB=1, zorder=1,
            patchA=boxes[source], patchB=boxes[target], linewidth=0.9, color="#6f8598",
            connectionstyle=f"arc3,rad={0.06 if x1 >= x0 else -0.06}",
        ))  # fmt: skip
    return figure


if __name__ == "__main__":
    draw().savefig(ROOT / "docs" / "figures" / "architecture.png")
