"""Cases of rolling: a relaxing half-plane by another program, and a heap of plastic mix by slip-line theory.

Half-plane: the output of the program CONTACT for two cylinders of PA6, and the resistance.

Two like bodies in contact are one half-plane of half the stiffness under a rigid roller,

    E* = E/(1 - nu^2),  E = 2 (G/2)(1 + nu)

with the shear modulus G of each body and the combined radius. A body with the creep time T under constant stress and
moduli G, 2 G has the relaxation time T/2. The half-plane is a layer of many contact lengths. The layer must also be
thick over the travel within one relaxation time, 0.45 m at 100 m/s: one of 10 m has 0.2 % less resistance there, and
6 % less at 1000 m/s.

Heap: a roller that pushes a growing heap without compaction, step by step.

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
from compact.engines.fem import engine as fem
from compact.engines.spectral import engine as spectral
from compact.material.laws import Elastic, Viscoelastic
from compact.numerics import Array
from compact.rolling_contact import Contact, Layer, Roller
from compact.validation.case import Computed, Panel, Rows, numbers, ours, read_rows, theirs
from compact.validation.compaction import MIX, shear_strength

SHEAR_MODULUS, POISSON = 1143e6, 0.4  # [Pa], of each body at first; [-]
CYLINDER, LOAD, SPEED = 0.05, 600e3, 1.0  # [m], combined; [N/m]; [m/s]
LAYER_HEIGHT = {"spectral": 1e4, "fem": 100.0}  # [m]
SERIES_CREEP_TIME = 0.009  # [s], of the resistance over speed
FIGURE_SPEEDS = np.geomspace(1e-3, 100.0, 41)  # [m/s]


def _roll(engine: str, creep_time: float, speed: float, *, relaxes: bool = True) -> Contact:
    """Compute one contact of the relaxing half-plane; without a creep time it is elastic."""
    shear_modulus = SHEAR_MODULUS / 2
    if relaxes:
        shear_modulus /= 2  # two like springs in series with the dashpot
    elastic = Elastic(youngs_modulus=2 * shear_modulus * (1 + POISSON), poisson=POISSON)
    material = Viscoelastic(**vars(elastic), branches=((1.0, creep_time / 2),)) if creep_time else elastic
    layer, roller = Layer(LAYER_HEIGHT[engine]), Roller(CYLINDER, load=LOAD)
    if engine == "fem":
        return fem.roll(layer, roller, material, speed, estimate=False)
    return spectral.roll(layer, roller, material, speed)


def _resistance(engine: str, speed: float) -> float:
    """Compute resistance over load [-] at a speed [m/s]."""
    found = _roll(engine, SERIES_CREEP_TIME, speed)
    return float(found.resistance / found.load)


def relaxing_half_plane(rows: Rows) -> Computed:
    """Compute peak pressures, contact lengths and the resistance over speed."""
    values: dict[str, float] = {}
    series: dict[str, list[tuple[float, float, float]]] = {"spectral": [], "fem": []}
    for key in rows:
        name, _, quantity = key.rpartition("_")
        if name in series:
            values[key] = _resistance(name, float(quantity))
            series[name].append((float(quantity), values[key], rows[key].theirs))
        elif quantity == "peak":
            creep_time = 0.0 if name == "elastic" else float(name.removeprefix("creep_"))
            found = _roll("spectral", creep_time, SPEED, relaxes=name != "elastic")
            values |= {key: found.peak_pressure / 1e6, f"{name}_length": 1e3 * (found.leading - found.trailing)}
    speeds, by_fem, expected = np.array(series["fem"]).T
    curves = (
        ours("spectral", FIGURE_SPEEDS, [_resistance("spectral", speed) for speed in FIGURE_SPEEDS.tolist()]),
        ours("fem", speeds, by_fem),
        theirs("collocation", speeds, expected),
    )
    return values, [Panel("speed [m/s]", "resistance over load [-]", curves, log_x=True)]


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
