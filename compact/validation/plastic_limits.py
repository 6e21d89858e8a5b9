"""Case of a limit load: Prandtl's pressure under a slow smooth indenter, by the finite elements of `compaction`.

On its flat subcritical side the mix of `compaction` yields at q = M pc/2 without change of volume, which is von Mises'
law with the shear strength k = M pc/(2 sqrt 3). Prandtl's solution needs mean pressures up to (1 + pi) k, which lie on
the flat side for M <= 0.418. A rigid strip is pressed into a half-plane of small strains until the pressure is steady;
half of the strip has the given number of elements, which grow away from it.
"""

import numpy as np

from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, SolidState
from compact.material.laws import Compaction
from compact.mesh import RowMesh
from compact.numerics import Array
from compact.validation.case import Comparison, Evaluation, Panel, ValidationCase, ours, theirs

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
EXPECTED = 0.02  # [-]
PLATEAU = 2e-3  # [-], rise of the pressure over the last tenth of the settlement
SOLVER_REPEAT = 1e-4  # [-], as the residual


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


def _evaluate() -> Evaluation:
    exact = 2 + np.pi
    paths = {elements: indenter_pressure(elements, steps) for elements, steps in MESHES}
    coarse, fine = (float(pressure[-1]) for _, pressure in paths.values())
    _, pressure = paths[MESHES[-1][0]]
    rise = float(pressure[-1] / np.interp(0.9 * SETTLEMENT, *paths[MESHES[-1][0]]) - 1)
    comparisons = (
        Comparison(
            "coarse", f"mean pressure over k, {MESHES[0][0]} elements", "-", coarse, exact, EXPECTED,
            explanation=f"twice as many elements halve the error, to {100 * (fine / exact - 1):.1f} %",
            repeat=SOLVER_REPEAT,
        ),
        Comparison(
            "fine", f"mean pressure over k, {MESHES[-1][0]} elements", "-", fine, exact, EXPECTED, repeat=SOLVER_REPEAT,
        ),
        Comparison(
            "limit", "mean pressure over k, extrapolated with first order", "-", 2 * fine - coarse, exact, EXPECTED,
            repeat=SOLVER_REPEAT,
        ),
        Comparison(
            "plateau", "rise over the last tenth of the settlement", "-", rise, 0.0, PLATEAU, absolute=True, repeat=0.1,
        ),
    )  # fmt: skip
    lines = [ours(f"{elements} elements", *path) for elements, path in paths.items()]
    limit = theirs("Prandtl", [SETTLEMENT], [exact])
    return Evaluation(comparisons, (Panel("settlement over width [-]", "mean pressure over k [-]", (*lines, limit)),))


PRANDTL = ValidationCase(
    "prandtl-indenter",
    "Slow indenter on a plastic half-plane",
    "exact",
    ("compaction",),
    "L. Prandtl, Nachr. Ges. Wiss. Goettingen (1920) 74: mean pressure (2 + pi) k of a smooth rigid strip",
    "formula",
    "A rigid strip on mix with M = 0.4 and no tensile strength, k = 18.6 kPa and E/k = 1076, in plane strain and small "
    "strains. The mix stays on the flat subcritical side, so that nothing compacts. The error of the mesh is positive: "
    "finite elements approach a limit load from above.",
    _evaluate,
    seconds=6.0,
)
