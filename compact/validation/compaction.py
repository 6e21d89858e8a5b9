"""Cases of compaction, flow and rolling, by columns, finite elements and theory.

In turn: sand in an oedometer; earth pressure, powder in a die and limit load by the ellipse; a relaxing half-plane by
another program; a heap of plastic mix by slip-line theory.

Sand: laws fitted to the first half of a test are held to the second half.

Loading is a power law with an offset, e = e_0 + B (s/s_a)^a, by three constants. Rebound is the logarithmic
swelling e_r = C ln(s_max/s) by one constant. The mix of `column` has Heckel's law and one modulus of unloading; it is
fitted to the same halves, to state how far it is from sand.

The first half of loading ends at half of the largest stress, and that of unloading at half of the readings.

The ellipse is that of modified Cam-clay with a tensile strength, hardened along Heckel's curve.

Earth pressure: rigid-plastic compression without lateral strain has one ratio of stresses for each slope M, which does
not depend on the hardening. One step of another program has its own elasticity and hardening, so that its stress is
held to the ellipse at its own preconsolidation pressure.

Powder in a die: the cap of a powder has constants that are tables over density. An ellipse has one slope M and
represents the powder over a range of density: M, tensile strength and moduli are those at the middle, and Heckel's line
runs through the isotropic yield at both ends. `data/ph102_ellipses.csv` has the constants of three ranges.

Limit load: on its flat subcritical side the mix yields at q = M pc/2 without change of volume, which is von Mises' law
with the shear strength k = M pc/(2 sqrt 3). Prandtl's solution (2 + pi) k under a slow smooth indenter needs mean
pressures up to (1 + pi) k, which lie on the flat side for M <= 0.418. Half of the strip has the given number of
elements, which grow away from it.

Half-plane: the output of the program CONTACT for two cylinders of PA6, and the resistance. Two like bodies in contact
are one half-plane of half the stiffness under a rigid roller,

    E* = E/(1 - nu^2),  E = 2 (G/2)(1 + nu)

with the shear modulus G of each body and the combined radius. A body with the creep time T under constant stress and
moduli G, 2 G has the relaxation time T/2. The half-plane is a layer of many contact lengths. The layer must also be
thick over the travel within one relaxation time, 0.45 m at 100 m/s: one of 10 m has 0.2 % less resistance there, and
6 % less at 1000 m/s.

Heap: a roller that pushes a growing heap without compaction, step by step. A smooth plate inclined by alpha, whose
lowest point is at the level of the surface, pushes a symmetric heap of a rigid-plastic half-plane with the shear
strength k. The pressure on the plate of length L is even,

    q = k (2 + pi - 4 alpha),   V = q L cos alpha,   H = q L sin alpha

A cylinder is compared by its chord, L = 2 R sin alpha, at the same heap, R (1 - cos 2 alpha). On the arc itself the fan
of slip lines turns with the slope t, so that q = k (2 + pi - 2 alpha - 2 t): the mean is the same, and the resultant is
steeper. Any depth kept heaps up without end in such a material, so that no steady state is compared: every step of
rolling has a heap, to which V, H and H/V refer. The heap is measured from the lowest point of the roller.
"""

import numpy as np
from scipy.optimize import least_squares

from compact.engines.column.engine import simulate_oedometer
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, SolidState
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
from compact.engines.fem import engine as fem
from compact.engines.spectral import engine as spectral
from compact.material import cap_plasticity
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.mesh import RowMesh, geometric
from compact.numerics import Array
from compact.rolling_contact import Contact, Layer, Roller
from compact.validation.case import Computed, Panel, Rows, numbers, ours, read_rows, theirs

REFERENCE_STRESS = 100.0  # [kPa], s_a
TESTS = {"OE1": "loose", "OE12": "dense"}
LEAST_STRESS = 1.0  # [kPa], below which the weight of the cap and the reading of the stress count
FIT_TOLERANCE = 1e-12  # [-], of the least squares


def _readings(test: str, phase: str) -> tuple[Array, Array, float]:
    """Return axial stress [kPa], strain [%] and the first density ratio [-] of a phase of a test."""
    rows = read_rows("sand_oedometers.csv", test=test, phase=phase)
    density_ratio = 1 / (1 + float(rows[0]["void_ratio"]))
    return numbers(rows, "axial_stress_kPa"), numbers(rows, "axial_strain_percent"), density_ratio


def power_strain(constants: Array, stress: Array) -> Array:
    """Return the strain [%] of the power law at stresses [kPa]."""
    return constants[0] + constants[1] * (stress / REFERENCE_STRESS) ** constants[2]


def _proportional(x: Array, y: Array) -> float:
    """Return the factor of the least squares of y = factor x."""
    return float(x @ y / (x @ x))


def _test(name: str) -> tuple[dict[str, float], Panel]:
    """Fit the laws to the first halves of a test, and return the rows of the second halves with the diagram."""
    stress, strain, k0 = _readings(name, "loading")
    released, left, _ = _readings(name, "unloading")
    top, rebound = stress[-1], left[0] - left
    first, second, half = (stress > 0) & (stress <= top / 2), stress > top / 2, len(released) // 2

    fit = least_squares(
        lambda constants: power_strain(constants, stress[first]) - strain[first],
        (0.0, 1.0, 0.5), xtol=FIT_TOLERANCE, ftol=FIT_TOLERANCE, gtol=FIT_TOLERANCE,
    ).x  # fmt: skip
    swelling = _proportional(np.log(top / released[:half]), rebound[:half])
    logarithm = np.log((1 - k0) / (1 - k0 / (1 - strain[first] / 100)))
    slope = _proportional(stress[first], logarithm)  # of Heckel's line

    def heckel_strain(stress: Array) -> Array:
        return 100 * (1 - k0 / (1 - (1 - k0) * np.exp(-slope * stress)))

    held = released >= LEAST_STRESS
    unloading = left[0] - swelling * np.log(top / released[held])
    values = {
        "loading": np.abs(power_strain(fit, stress[second]) / strain[second] - 1).max(),
        "largest": power_strain(fit, top),
        "rebound_10": swelling * np.log(top / 10.0),
        "rebound_1": swelling * np.log(top / 1.0),
        "unloading": np.abs(unloading / left[held] - 1).max(),
        "heckel": heckel_strain(top),
        "modulus": _proportional(top - released[:half], rebound[:half]) * top,
    }
    x = np.geomspace(0.5, top, 80)
    curves = (
        ours("power law", x, power_strain(fit, x)),
        ours("swelling", x, left[0] - swelling * np.log(top / x)),
        ours("Heckel's law", x, heckel_strain(x)),
        theirs("loading, fitted half", stress[first], strain[first]),
        theirs("unloading", released[:-1], left[:-1]),
        theirs("loading, second half", stress[second], strain[second]),
    )
    panel = Panel("axial stress [kPa]", f"axial strain [%], {name} ({TESTS[name]})", curves, log_x=True)
    return {f"{name}_{key}": float(value) for key, value in values.items()}, panel


def sand_tests(_rows: Rows) -> Computed:
    """Compute both tests."""
    (loose, left), (dense, right) = map(_test, TESTS)
    return loose | dense, (left, right)


RIGID_MODULUS = 1e13  # [Pa], some 1e8 times the pressure
STRAIN, STEPS = 0.3, 50  # [-], logarithmic, of the confined compression, and its increments
CURVE_SLOPES = np.linspace(0.7, 1.7, 11)  # [-]
PROGRAM_SLOPE = 1.2  # [-], M of a step of cb-geo/mpm
PROGRAM_STRESS = np.array([192882.482575, 192882.482575, 211655.010869])  # [Pa], compression after the step
PROGRAM_PRECONSOLIDATION = 200368.914682  # [Pa], after the step
MIX = Compaction(
    unloading_modulus=20e6, poisson=0.3, heckel_slope=10e-6, loose_density_ratio=0.5, critical_slope=0.4,
    tensile_strength=0.0, fed_density_ratio=0.9,
)  # fmt: skip
MESHES = ((6, 30), (12, 60))  # [-], elements over half of the strip, and steps of the settlement
SETTLEMENT = 0.05  # [-], at the end over the width of the strip
UNIFORM, REACH, DEPTH_SHARE = 0.75, 3.0, 0.6  # [-], over the width: even elements, width beside them, depth over it
GROWTH = 1.15  # [-], of elements away from the strip
RESIDUAL, ITERATIONS, CUTS = 1e-4, 40, 8  # [-], of an increment over the nodal forces; of it, and of a line search
NEAR = 1e-9  # [-], tolerance of coordinates
CONTINUATION = 1.05  # [-], of the first guess of an increment over the last one


def earth_pressure_at_rest(slope: float) -> float:
    """Compute lateral over vertical stress K0 [-] of nearly rigid mix in confined compression by its M [-]."""
    mix = Compaction(
        unloading_modulus=RIGID_MODULUS, poisson=0.3, heckel_slope=10e-6, loose_density_ratio=0.5, critical_slope=slope,
        tensile_strength=0.0, fed_density_ratio=0.6, dry_side="ellipse",
    )  # fmt: skip
    state, increment = cap_plasticity.initial_state(mix, 1), np.array([[0.0, -STRAIN / STEPS, 0.0]])
    for _ in range(STEPS):
        state, _ = cap_plasticity.integrate_points(mix, state, increment, tangent=False)
    return float(state.stress[0, 0] / state.stress[0, 1])


def earth_pressures(rows: Rows) -> Computed:
    """Compute earth pressures at rest over M, and the stress of one step of another program."""
    known = {float(key.removeprefix("K0_")): row.theirs for key, row in rows.items() if key.startswith("K0_")}
    p = PROGRAM_STRESS.mean()
    stress = PROGRAM_SLOPE * np.sqrt(p * (PROGRAM_PRECONSOLIDATION - p))
    values = {f"K0_{slope:g}": earth_pressure_at_rest(slope) for slope in known}
    curve = [earth_pressure_at_rest(slope) for slope in CURVE_SLOPES.tolist()]
    points = theirs("exact", list(known), list(known.values()))
    return values | {"cb_geo": float(stress)}, [
        Panel("M [-]", "earth pressure at rest [-]", (ours("material point", CURVE_SLOPES, curve), points))
    ]


def powder(rows: Rows) -> Computed:
    """Compute the axial stress in a die by one ellipse for each range of density."""
    values, curves = {}, []
    for row in read_rows("ph102_ellipses.csv"):
        law = {name: float(cell) for name, cell in row.items() if name != "source_and_how_read"}
        low, high, largest = (law.pop(name) for name in ("low", "high", "axial_stress_at_high"))
        test = simulate_oedometer(Compaction(**law), np.linspace(0.01, 1.4, 140) * largest)  # type: ignore[arg-type]
        for end in (low, high):
            stress = float(np.interp(end, test.density_ratio, test.pressure))
            values[f"ellipse_{low:g}_{high:g}_at_{end:g}"] = stress / 1e6
        density = np.linspace(low - 0.01, high + 0.01, 40)
        curves.append(
            ours(f"{low:g} to {high:g}", density, np.interp(density, test.density_ratio, test.pressure) / 1e6)
        )
    points = {float(key.rsplit("_", 1)[1]): row.theirs for key, row in rows.items()}
    curves.append(theirs("table", list(points), list(points.values())))
    return values, [Panel("density ratio [-]", "axial stress of one ellipse [MPa]", tuple(curves))]


def shear_strength(mix: Compaction) -> float:
    """Return the shear strength k = M pc/(2 sqrt 3) [Pa] of the flat side of a mix as fed."""
    return float(mix.critical_slope * mix.yield_pressure(mix.fed_density_ratio) / (2 * np.sqrt(3)))


def indenter_pressure(elements: int, steps: int) -> tuple[Array, Array]:
    """Press a smooth rigid strip of unit width into a half-plane.

    Parameters
    ----------
    elements : int
        Elements over half of the strip.
    steps : int
        Increments of the settlement.

    Returns
    -------
    tuple of ndarray
        Settlements over the width [-] and mean pressures over the shear strength [-], shape (steps,).
    """
    size = 0.5 / elements
    inner = np.linspace(0, UNIFORM, round(UNIFORM / size) + 1)
    x = np.concatenate([inner, UNIFORM + geometric(REACH, size, GROWTH, REACH)])
    y = np.concatenate([-geometric(UNIFORM + DEPTH_SHARE * REACH, size, GROWTH, REACH)[::-1], [0.0]])
    y -= y[0]
    mesh = RowMesh(np.tile(x, (len(y), 1)), y)
    nodes = FiniteStrainSolid(mesh, MIX).basis.doflocs.T
    bottom, sides = nodes[:, 1] < NEAR, (nodes[:, 0] < NEAR) | (nodes[:, 0] > x[-1] - NEAR)
    moving = 2 * np.flatnonzero((nodes[:, 1] > y[-1] - NEAR) & (nodes[:, 0] < 0.5 + NEAR)) + 1
    fixed = np.concatenate([2 * np.flatnonzero(sides | bottom), 2 * np.flatnonzero(bottom) + 1, moving])
    solid = FiniteStrainSolid(mesh, MIX, fixed_dofs=fixed, finite=False, substeps=1)
    state, found = solid.undeformed_state(), []
    change = np.zeros_like(state.displacement)
    settlement = SETTLEMENT * np.linspace(0, 1, steps + 1) ** 2
    for step in np.diff(settlement).tolist():
        moved, before = state.displacement + change, state.displacement
        moved.ravel()[moving] = before.ravel()[moving] - step
        state, forces = solve_increment(solid, state, moved)
        change = CONTINUATION * (state.displacement - before)
        found.append(-forces.ravel()[moving].sum() / 0.5)
    return settlement[1:], np.array(found) / shear_strength(MIX)


def solve_increment(
    solid: FiniteStrainSolid, state: SolidState, moved: Array, applied: Array | float = 0.0
) -> tuple[SolidState, Array]:
    """Solve the equilibrium after a prescribed displacement of the fixed degrees of freedom by Newton's method.

    Parameters
    ----------
    moved : ndarray, shape (n, 2)
        First guess of the displacements [m], with the prescribed ones.
    applied : ndarray, shape (n, 2), optional
        Applied nodal forces [N/m].

    Returns
    -------
    tuple
        State and nodal forces [N/m], shape (n, 2), after the increment.

    Raises
    ------
    RuntimeError
        If the increment has no equilibrium.
    """
    free, near, displacement = solid.ordered_dofs, None, moved.copy()
    increment = solid.increment(state, displacement)
    for _ in range(ITERATIONS):
        forces = increment.internal_forces
        residual = (applied - forces).ravel()[free]
        size = np.linalg.norm(residual) / max(np.linalg.norm(forces), np.linalg.norm(applied))
        if size < RESIDUAL:
            return increment.after, forces
        solve = solid.factorise(increment.element_stiffness, np.empty(0, dtype=int), np.empty((0, 2, 2)))
        direction, length = solve(residual), 1.0
        for _ in range(CUTS):
            trial = displacement.copy()
            trial.ravel()[free] += length * direction
            found = solid.increment(state, trial, near=near)
            rest = (applied - found.internal_forces).ravel()[free]
            if np.linalg.norm(rest) < (1 - 0.1 * length) * np.linalg.norm(residual):
                break
            length /= 2
        displacement, increment, near = trial, found, found
    raise RuntimeError(f"no equilibrium: residual {size:.1e} after {ITERATIONS} iterations")


def indenter(rows: Rows) -> Computed:
    """Compute the limit load on two meshes."""
    paths = [indenter_pressure(*mesh) for mesh in MESHES]
    coarse, fine = (float(pressure[-1]) for _, pressure in paths)
    rise = fine / float(np.interp(0.9 * SETTLEMENT, *paths[-1])) - 1
    values = {"coarse": coarse, "fine": fine, "limit": 2 * fine - coarse, "plateau": rise}
    curves = [ours(f"{elements} elements", *path) for (elements, _), path in zip(MESHES, paths, strict=True)]
    curves.append(theirs("Prandtl", [SETTLEMENT], [rows["limit"].theirs]))
    return values, [Panel("settlement over width [-]", "mean pressure over k [-]", tuple(curves))]


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
HEAP_MESHES = (4, 8)  # [-], elements per contact length at the largest heap
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
    """Compute forces over the heap on two meshes."""
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
    for increments in HEAP_MESHES:
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
