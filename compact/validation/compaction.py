"""Cases of compaction and flow: sand in an oedometer; earth pressure, powder in a die and limit load by the ellipse.

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
"""

import numpy as np
from scipy.optimize import least_squares

from compact.engines.column.engine import simulate_oedometer
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, SolidState
from compact.material import cap_plasticity
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics import Array
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
    x = np.concatenate([inner, UNIFORM + _graded(REACH, size)])
    y = np.concatenate([-_graded(UNIFORM + DEPTH_SHARE * REACH, size)[::-1], [0.0]])
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


def _graded(length: float, first: float) -> Array:
    """Return coordinates up to a length whose intervals grow from the first."""
    sizes = [first]
    while sum(sizes) < length:
        sizes.append(sizes[-1] * GROWTH)
    return np.cumsum(sizes) * length / sum(sizes)


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
