"""The same cases by this program and by open codes: result and processor time beside each other.

    pip install ContactMechanics tamaas ngsolve jaxmat
    python studies/open_codes.py [--markdown]

A code that is not installed is named and left out; scikit-fem always is. Each case has one definition, below.

layer       smooth cylinder pressed into an elastic layer bonded to a rigid base, load at a prescribed indentation
            spectral, fem       the engines of this program
            ContactMechanics    Green's function of the layer on a periodic grid, constrained conjugate gradients;
                                the thickness acts on two-dimensional grids alone, hence two rows of points
            NGSolve, scikit-fem finite elements of the symmetric half by hand, contact by a penalty
half-plane  smooth cylinder on a half-plane, peak pressure at a prescribed load
            hertz               closed form
            tamaas              boundary elements on a periodic line, whose period raises the pressure slightly
cap         stress of one point of mix along a strain path, elliptic cap with Heckel's hardening
            return mapping      the compiled return mapping of this program
            jaxmat              the same equations as one system, with derivatives by automatic differentiation

The penalty of the finite elements by hand, 1e13 Pa/m, lowers the load by 3e-5. The first run of a code contains imports
and compilation; a second one in the same process may use what the first has kept, as `fem` does with the compliance of
its mesh.
"""

import argparse
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from time import process_time

import numpy as np
from threadpoolctl import threadpool_limits

RADIUS, HEIGHT, INDENTATION = 0.11, 0.06, 0.002  # [m]
MODULUS, POISSON = 10e6, 0.3  # [Pa], [-]
LOAD = 16.26e3  # [N/m], of the half-plane
PENALTY = 1e13  # [Pa/m]
HALF_WIDTH, CONTACT = 0.3, 0.016  # [m], of the symmetric half, and a length that contains its contact
PERIOD, POINTS = 0.6, 2048  # [m], [-], of the grid of ContactMechanics
LINE_PERIOD, LINE_POINTS = 4.8, 16384  # [m], [-], of tamaas
MAX_ITERATIONS, STEP_TOLERANCE = 60, 1e-10  # [-], of Newton's method by hand
CAP = {"youngs": 120e6, "poisson": 0.3, "slope": 25e-6, "loose": 0.72, "critical": 0.99, "tensile": 14281.0}
FED = 0.93576  # [-], density ratio of the fed mix
PATH, STEPS = (-2e-4, -1e-3, 2e-4), 40  # [-], strain xx, yy, 2 xy of a step of the path


@dataclass(frozen=True)
class Row:
    """One code and its answer.

    Parameters
    ----------
    case, code : str
        Names.
    value : float
        Load [N/m], peak pressure [Pa] or vertical stress [Pa].
    first, second : float
        Processor time of the first and of the second run in one process [s].
    difference : float
        Relative difference to the first row of the case [-].
    """

    case: str
    code: str
    value: float
    first: float
    second: float
    difference: float


def lame_constants():
    """Return Lame's constants of the layer [Pa]."""
    return MODULUS * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), MODULUS / (2 * (1 + POISSON))


def layer_by_engine(name):
    """Return the load by an engine of this program [N/m]."""
    from compact.material.laws import Elastic
    from compact.rolling_contact import Layer, Roller

    engine = importlib.import_module(f"compact.engines.{name}.engine")
    return engine.roll(
        Layer(HEIGHT), Roller(RADIUS, indentation=INDENTATION), Elastic(youngs_modulus=MODULUS, poisson=POISSON), 0.1
    ).load


def layer_by_contact_mechanics():
    """Return the load on two equal rows of a periodic grid [N/m]."""
    from ContactMechanics import PeriodicFFTElasticHalfSpace
    from ContactMechanics.Systems import NonSmoothContactSystem
    from SurfaceTopography import Topography

    pixel = PERIOD / POINTS
    x = (np.arange(POINTS) + 0.5) * pixel - PERIOD / 2
    sizes = PERIOD, 2 * pixel
    surface = Topography(np.tile(-(x[:, None] ** 2) / (2 * RADIUS), 2), sizes, periodic=True)
    layer = PeriodicFFTElasticHalfSpace((POINTS, 2), MODULUS, sizes, thickness=HEIGHT, poisson=POISSON)
    system = NonSmoothContactSystem(layer, surface)
    if not system.minimize_proxy(offset=INDENTATION, pentol=1e-12).success:
        raise RuntimeError("ContactMechanics did not converge")
    return abs(float(np.sum(system.force))) / (2 * pixel)


def layer_by_scikit_fem():
    """Return the load by biquadratic elements of scikit-fem [N/m]."""
    from skfem import (
        Basis,
        BilinearForm,
        ElementQuad2,
        ElementVector,
        FacetBasis,
        LinearForm,
        MeshQuad,
        condense,
        solve,
    )
    from skfem.models.elasticity import linear_elasticity

    x = np.concatenate([np.linspace(0, CONTACT, 33), CONTACT + (HALF_WIDTH - CONTACT) * np.linspace(0, 1, 41)[1:] ** 2])
    y = -HEIGHT * np.linspace(0, 1, 25)[::-1] ** 1.8
    mesh = MeshQuad.init_tensor(x, y).with_boundaries(
        {
            "top": lambda x: (x[1] == 0) & (x[0] < CONTACT),
            "base": lambda x: x[1] == -HEIGHT,
            "axis": lambda x: x[0] == 0,
        }
    )
    basis = Basis(mesh, ElementVector(ElementQuad2()))
    top = FacetBasis(mesh, basis.elem, facets=mesh.boundaries["top"], intorder=12)
    stiffness = linear_elasticity(*lame_constants()).assemble(basis)
    fixed = np.unique(np.concatenate([basis.get_dofs("base").all(), basis.get_dofs("axis").all("u^1")]))

    def overlap(w):
        return np.maximum(INDENTATION - w.x[0] ** 2 / (2 * RADIUS) + w["u"][1], 0.0)

    pressing = LinearForm(lambda v, w: PENALTY * overlap(w) * v[1])
    tangent = BilinearForm(lambda u, v, w: PENALTY * (overlap(w) > 0) * u[1] * v[1])
    u = basis.zeros()
    for _ in range(MAX_ITERATIONS):
        state = top.interpolate(u)
        force, matrix = pressing.assemble(top, u=state), tangent.assemble(top, u=state)
        change = solve(*condense(stiffness + matrix, -(stiffness @ u + force), D=fixed))
        u += change
        if np.linalg.norm(change) < STEP_TOLERANCE * np.linalg.norm(u):
            return 2 * float(force[basis.get_dofs("top").all("u^2")].sum())
    raise RuntimeError("scikit-fem by hand did not converge")


def layer_by_ngsolve():
    """Return the load by triangles of order 4 of NGSolve [N/m]."""
    import ngsolve as ng
    from netgen.geom2d import SplineGeometry

    shape = SplineGeometry()
    corners = ((0, -HEIGHT), (HALF_WIDTH, -HEIGHT), (HALF_WIDTH, 0), (CONTACT, 0), (0, 0))
    points = [shape.AppendPoint(*corner) for corner in corners]
    for k, name in enumerate(("base", "end", "free", "top", "axis")):
        size = {"maxh": CONTACT / 64} if name == "top" else {}
        shape.Append(["line", points[k], points[(k + 1) % 5]], bc=name, **size)
    mesh = ng.Mesh(shape.GenerateMesh(maxh=HEIGHT / 4, grading=0.3))
    space = ng.VectorH1(mesh, order=4, dirichletx="axis|base", dirichlety="base")
    u, (first, second) = space.TrialFunction(), lame_constants()

    def overlap(displacement):
        gap = INDENTATION - ng.x * ng.x / (2 * RADIUS) + displacement[1]
        return ng.IfPos(gap, gap, 0)

    strain, top = ng.Sym(ng.Grad(u)), ng.ds("top", bonus_intorder=10)
    energy = ng.BilinearForm(space, symmetric=True)
    energy += ng.Variation((second * ng.InnerProduct(strain, strain) + first / 2 * ng.Trace(strain) ** 2) * ng.dx)
    energy += ng.Variation(PENALTY / 2 * overlap(u) ** 2 * top)
    found = ng.GridFunction(space)
    residual = found.vec.CreateVector()
    for _ in range(MAX_ITERATIONS):
        energy.Apply(found.vec, residual)
        energy.AssembleLinearization(found.vec)
        change = energy.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky") * residual
        found.vec.data -= change
        if ng.Norm(change) < STEP_TOLERANCE * ng.Norm(found.vec):
            return 2 * ng.Integrate(PENALTY * overlap(found) * top, mesh)
    raise RuntimeError("NGSolve by hand did not converge")


def half_plane_by_hertz():
    """Return the peak pressure in closed form [Pa]."""
    from compact.engines.halfplane import hertz

    return float(hertz(radius=RADIUS, load=LOAD, contact_modulus=MODULUS / (1 - POISSON**2)).peak_pressure)


def half_plane_by_tamaas():
    """Return the peak pressure by boundary elements on a periodic line [Pa]."""
    import tamaas

    tamaas.set_log_level(tamaas.LogLevel.error)
    model = tamaas.Model(tamaas.model_type.basic_1d, [LINE_PERIOD], [LINE_POINTS])
    model.E, model.nu = MODULUS, POISSON
    x = np.linspace(-0.5, 0.5, LINE_POINTS, endpoint=False) * LINE_PERIOD
    solver = tamaas.PolonskyKeerRey(model, -(x**2) / (2 * RADIUS), 1e-12)
    solver.solve(LOAD / LINE_PERIOD)
    return float(model.traction[:].max())


def cap_by_return_mapping():
    """Return the vertical stress at the end of the path by this program [Pa]."""
    from compact.material.cap_plasticity import initial_state, integrate_points
    from compact.material.laws import Compaction

    law = Compaction(
        unloading_modulus=CAP["youngs"],
        poisson=CAP["poisson"],
        heckel_slope=CAP["slope"],
        loose_density_ratio=CAP["loose"],
        critical_slope=CAP["critical"],
        tensile_strength=CAP["tensile"],
        fed_density_ratio=FED,
    )
    state, strain = initial_state(law, 1), np.array([PATH])
    for _ in range(STEPS):
        state, _ = integrate_points(law, state, strain, tangent=False)
    return float(state.stress[0, 1])


def cap_by_jaxmat():
    """Return the vertical stress at the end of the path by jaxmat [Pa]."""
    import equinox
    import jax
    import optimistix
    from jax import numpy as jnp
    from jaxmat.materials import LinearElasticIsotropic, SmallStrainBehavior
    from jaxmat.state import AbstractState
    from jaxmat.tensors import SymmetricTensor2, dev
    from jaxmat.tensors.utils import FischerBurmeister
    from optax.tree_utils import tree_zeros_like

    jax.config.update("jax_enable_x64", True)

    class PlasticStrain(AbstractState):
        plastic: SymmetricTensor2 = equinox.field(default_factory=SymmetricTensor2)

    class EllipticCap(SmallStrainBehavior):
        elasticity: LinearElasticIsotropic
        internal_type = PlasticStrain

        @equinox.filter_jit
        def constitutive_update(self, strain, state, dt):
            def stress_after(flow):
                return state.stress + self.elasticity.C @ (strain - state.strain - flow)

            def residual(unknowns, _):
                multiplier, flow = unknowns

                def surface(stress):
                    p, s = -jnp.trace(stress) / 3, dev(stress)
                    density = FED * jnp.exp(-jnp.trace(state.internal.plastic + flow))
                    cap = jnp.log((1 - CAP["loose"]) / (1 - density)) / CAP["slope"]
                    return 1.5 * jnp.vdot(s, s) / CAP["critical"] ** 2 + (p + CAP["tensile"]) * (p - cap)

                stress = stress_after(flow)
                flow_error = flow - multiplier * jax.jacfwd(surface)(stress)
                return (flow_error, FischerBurmeister(-1e3 * surface(stress) / CAP["youngs"] ** 2, multiplier)), None

            start = 0.0, tree_zeros_like(state.internal.plastic)
            found = optimistix.root_find(residual, self.solver, y0=start, has_aux=True, adjoint=self.adjoint)
            flow = found.value[1]
            internal = state.internal.update(plastic=state.internal.plastic + flow)
            stress = stress_after(flow)
            return stress, state.update(strain=strain, stress=stress, internal=internal)

    solver = optimistix.Newton(rtol=1e-12, atol=1e-14)
    mix = EllipticCap(elasticity=LinearElasticIsotropic(E=CAP["youngs"], nu=CAP["poisson"]), solver=solver)
    xx, yy, xy = PATH
    step = SymmetricTensor2(tensor=jnp.array([[xx, xy / 2, 0.0], [xy / 2, yy, 0.0], [0.0, 0.0, 0.0]]))
    state = mix.init_state()
    for _ in range(STEPS):
        stress, state = mix.constitutive_update(state.strain + step, state, 1.0)
    return float(stress.tensor[1, 1])


CASES: dict[str, dict[str, Callable[[], float]]] = {
    "layer": {
        "spectral": lambda: layer_by_engine("spectral"),
        "fem": lambda: layer_by_engine("fem"),
        "ContactMechanics": layer_by_contact_mechanics,
        "NGSolve by hand": layer_by_ngsolve,
        "scikit-fem by hand": layer_by_scikit_fem,
    },
    "half-plane": {"hertz": half_plane_by_hertz, "tamaas": half_plane_by_tamaas},
    "cap": {"return mapping": cap_by_return_mapping, "jaxmat": cap_by_jaxmat},
}
UNITS = {"layer": "load, N/m", "half-plane": "peak pressure, Pa", "cap": "vertical stress, Pa"}


def compare(cases=CASES):
    """Return the rows of the codes that are installed, and the names of those that are not."""
    rows, missing = [], []
    for case, codes in cases.items():
        reference = None
        for code, compute in codes.items():
            times = [process_time()]
            try:
                for _ in range(2):
                    value = compute()
                    times.append(process_time())
            except ModuleNotFoundError:
                missing.append(code)
                continue
            reference = value if reference is None else reference
            rows.append(Row(case, code, value, *np.diff(times), value / reference - 1))
    return rows, missing


def show(rows, missing, *, markdown=False):
    """Print a table of the rows."""
    left, middle, right = ("| ", " | ", " |") if markdown else ("", "  ", "")
    columns = (
        ("case", 10),
        ("quantity", 20),
        ("code", 18),
        ("value", 12),
        ("difference", 10),
        ("first, s", 9),
        ("second, s", 9),
    )
    print(left + middle.join(f"{name:<{width}}" for name, width in columns) + right)
    if markdown:
        print(left + middle.join("-" * width for _, width in columns) + right)
    for row in rows:
        numbers = f"{row.value:.6g}", f"{row.difference:+.1e}", f"{row.first:.2f}", f"{row.second:.4f}"
        cells = row.case, UNITS[row.case], row.code, *numbers
        print(left + middle.join(f"{cell:<{width}}" for cell, (_, width) in zip(cells, columns, strict=True)) + right)
    if missing:
        print(f"not installed: {', '.join(missing)}")


def main(arguments=None):
    """Parse the command line, compare and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--markdown", action="store_true", help="print the table as Markdown")
    given = parser.parse_args(arguments)
    with threadpool_limits(1):
        rows, missing = compare()
    show(rows, missing, markdown=given.markdown)


if __name__ == "__main__":
    main()
