"""Case of slip-line theory: a roller that pushes a growing heap of mix without compaction, step by step.

A smooth plate inclined by alpha, whose lowest point is at the level of the surface, pushes a symmetric heap of a
rigid-plastic half-plane with the shear strength k. The pressure on the plate of length L is even,

    q = k (2 + pi - 4 alpha),   V = q L cos alpha,   H = q L sin alpha

A cylinder is compared by its chord, L = 2 R sin alpha, at the same heap, R (1 - cos 2 alpha). On the arc itself the fan
of slip lines turns with the slope t, so that q = k (2 + pi - 2 alpha - 2 t): the mean is the same, and the resultant is
steeper. Any depth kept heaps up without end in such a material, so that no steady state is compared: every step of
rolling has a heap, to which V, H and H/V refer. The heap is measured from the lowest point of the roller.
"""

import numpy as np

from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.numerics import Array
from compact.rolling_contact import Layer, Roller
from compact.validation.case import Computed, Panel, Rows, numbers, ours, read_rows, theirs
from compact.validation.plasticity import MIX, shear_strength

RADIUS, HEIGHT = 0.1, 0.2  # [m], of the roller and of the layer, six contact lengths at the largest heap
DEPTH = 0.5e-3  # [m], of the lowest point
FIRST_STEPS = 6  # [-], of rolling, in which the depth is reached
HEAPS = (3e-3, 6e-3)  # [m], between which ratios are averaged
MESHES = (6, 12, 24)  # [-], elements per contact length at the largest heap
DAMPING = 2e-3  # [-], artificial, as a share of the elastic stiffness
MAX_TRAVEL = 0.7  # [m]


def chord_forces(heap: Array) -> tuple[Array, Array]:
    """Return V/(k R) and H/(k R) [-] of the chord at heaps over the radius [-]."""
    alpha = np.arccos(1 - heap) / 2
    force = (2 + np.pi - 4 * alpha) * 2 * np.sin(alpha)
    return force * np.cos(alpha), force * np.sin(alpha)


def arc_forces(heap: Array) -> tuple[Array, Array]:
    """Return V/(k R) and H/(k R) [-] of the arc at heaps over the radius [-]."""
    end = np.arccos(1 - heap)  # slope at the top
    base = 2 + np.pi - end
    vertical = base * np.sin(end) - 2 * (end * np.sin(end) + np.cos(end) - 1)
    horizontal = base * (1 - np.cos(end)) - 2 * (np.sin(end) - end * np.cos(end))
    return vertical, horizontal


def heap_path(increments: int) -> Array:
    """Roll over the layer until the heap exceeds the compared ones.

    Parameters
    ----------
    increments : int
        Elements per contact length at the largest heap.

    Returns
    -------
    ndarray, shape (3, n)
        Heap [m], V/(k R) and H/(k R) [-] of each step.
    """
    roller = Roller(RADIUS, indentation=HEAPS[1], profile="deformed")
    numerics = RollingNumerics(increments=increments, max_contact_angle=None)
    case = RollingCase(Layer(HEIGHT), roller, MIX, 1.0, None, None, numerics)
    rolling = case.roller_at_rest(case.create_frame(HEAPS[1], increments))
    rows: list[tuple[float, float, float]] = []
    scale = shear_strength(MIX) * RADIUS
    while not rows or (rows[-1][0] < HEAPS[1] and rolling.steps[-1].travel < MAX_TRAVEL):
        depth = DEPTH * min(1.0, (len(rows) + 1) / FIRST_STEPS)
        step = rolling.advance(HEIGHT - depth, DAMPING)
        rows.append((step.bow_wave + depth, step.load / scale, step.resistance / scale))
    return np.array(rows).T


def _mean_ratios(path: Array, forces: tuple[Array, Array]) -> tuple[float, float, float]:
    """Return V, H and H/V over those of a theory [-], means over the compared heaps."""
    used = (path[0] >= HEAPS[0]) & (path[0] <= HEAPS[1])
    vertical, horizontal = path[1] / forces[0], path[2] / forces[1]
    return vertical[used].mean(), horizontal[used].mean(), (horizontal / vertical)[used].mean()


def pushed_heap(_rows: Rows) -> Computed:
    """Compute forces over the heap on three meshes."""
    table = read_rows("ironing_plate_plastic.csv")
    vertical, horizontal = chord_forces(numbers(table, "cylinder_chord_heap_over_R"))
    published = numbers(table, "cylinder_chord_vertical_over_kR"), numbers(table, "horizontal_over_vertical")
    deviation = np.abs([vertical / published[0] - 1, horizontal / vertical / published[1] - 1])
    values: dict[str, float] = {"formula": deviation.max()}

    heap = np.linspace(1e-3, HEAPS[1], 26)
    theories = {"chord": chord_forces(heap / RADIUS), "arc": arc_forces(heap / RADIUS)}
    points = [
        [theirs(name, 1e3 * heap, vertical) for name, (vertical, _) in theories.items()],
        [theirs(name, 1e3 * heap, horizontal / vertical) for name, (vertical, horizontal) in theories.items()],
    ]
    lines: list[list] = [[], []]
    for increments in MESHES:
        path = heap_path(increments)
        ratios = _mean_ratios(path, chord_forces(path[0] / RADIUS))
        values |= dict(zip((f"V_{increments}", f"H_{increments}", f"H_over_V_{increments}"), ratios, strict=True))
        x, vertical, horizontal = path[:, path[0] > heap[0]]
        lines[0].append(ours(f"{increments} elements", 1e3 * x, vertical))
        lines[1].append(ours(f"{increments} elements", 1e3 * x, horizontal / vertical))
    values["arc"] = _mean_ratios(path, arc_forces(path[0] / RADIUS))[2]
    labels = "V/(k R) [-]", "H/V [-]"
    return values, [
        Panel("heap above the lowest point [mm]", label, (*each, *theory))
        for label, each, theory in zip(labels, lines, points, strict=True)
    ]
