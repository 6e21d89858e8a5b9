"""Time of each method compared with plain code.

The ratios are meaningful; seconds depend on the machine. Formulas: points per second over arrays in which every
argument varies. Laws: position to snap at many instants compared with one numpy.polyval of the degree of the law per
derivative. Peaks: sampling at n instants compared with the roots that `peaks` computes. Layers: cost of a first speed,
a further one and twenty by finite elements, and of a direct solution on the same mesh with one LU decomposition for
each set of nodes in contact. Commands: whole processes.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from timeit import repeat

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, ElementVector, LinearForm, MeshQuad, asm
from skfem.helpers import ddot, eye, sym_grad, trace
from skfem.models.elasticity import lame_parameters, linear_elasticity

from compact import contact, fem
from compact.engines.fem import compliance
from compact.engines.spectral import engine as spectral
from compact.material.laws import Viscoelastic
from compact.motion.profile import law
from compact.report.progress import Progress
from compact.rolling_contact import Layer, Roller

SCENE = Path(__file__).parents[1] / "compact" / "data" / "scenes" / "loveikin-2015.toml"
LAYER = Layer(0.22)
MIX = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))  # of the published machine
ROLLER = Roller(0.11, indentation=0.003)
TARGETS = ({"indentation": 0.003}, {"load": 15e3}, {"peak_pressure": 0.7e6})
LAW_DEGREES = {"quintic": 5, "septic": 7, "reversal-4": 7, "combined-4": 7}
SPEED_NAMES = ("first speed", "further speed", "all speeds")


def peak_memory(whose):
    """Return the peak memory of this process or of ended ones [MB]; nan on Windows, which does not count it."""
    try:
        import resource
    except ImportError:
        return np.nan
    return resource.getrusage(getattr(resource, whose)).ru_maxrss / 1024


def least(work, repeats):
    """Return the seconds of the fastest of several calls."""
    return min(repeat(work, number=1, repeat=repeats))


def formula_calls(points, rng=None):
    """Return eqs 1.1-1.10 as calls on arrays of `points` values, every argument an array."""
    rng = rng or np.random.default_rng(1)

    def spread(low, high):
        return rng.uniform(low, high, points)

    nu, f, q, modulus, radius = spread(0.1, 0.4), spread(0, 0.6), spread(1e5, 3e5), spread(1e6, 2e6), spread(0.08, 0.2)
    alpha = contact.pressure_exponent(nu, f)
    phi = contact.capture_angle(q, modulus, nu, alpha)
    length, force = contact.contact_length(phi, radius, alpha), spread(5e3, 2e4)
    lengths = {"journal_diameter": radius / 5, "rolling_arm": radius / 200, "wheel_diameter": radius / 2}
    guide = {"bearing_friction": f, "rib_factor": 1 + f} | lengths
    return {
        "1.1": lambda: contact.radius_range(radius),
        "1.2": lambda: contact.rollers_needed(10 * radius, radius, radius, radius / 10),
        "1.3": lambda: contact.stroke_needed(10 * radius, 3, radius / 10),
        "1.4": lambda: contact.pressure_exponent(nu, f),
        "1.5": lambda: contact.capture_angle(q, modulus, nu, alpha),
        "1.6": lambda: contact.roller_force(phi, modulus, nu, alpha, radius, length),
        "1.7": lambda: contact.contact_length(phi, radius, alpha),
        "1.8": lambda: contact.roller_resistance(force, length, radius, alpha, f),
        "1.9": lambda: contact.cart_resistance(force, force / 5, 2, force, **guide),
        "1.10": lambda: contact.cart_power(force, f),
    }


def formulas(points, repeats):
    """Return the points per second of each formula."""
    return {name: points / least(call, repeats) for name, call in formula_calls(points).items()}


def laws(points, repeats):
    """Return the time of five derivatives over that of five numpy.polyval of the degree of each derivative."""
    time = np.linspace(0, 3, points)
    ratios = {}
    for name, degree in LAW_DEGREES.items():
        motion, coefficients = law(name, 0.4, 3.0), np.arange(degree + 1.0)
        laws_time = least(lambda motion=motion: [motion.derivative(time, k) for k in range(5)], repeats)
        polyval_time = least(lambda c=coefficients: [np.polyval(c[k:], time) for k in range(5)], repeats)
        ratios[name] = laws_time / polyval_time
    return ratios


def peaks(samples, repeats):
    """Return (instants, relative error, time over that of `peaks`) of the peak acceleration by sampling."""
    motion = law("combined-4", 0.4, 3.0)
    exact = motion.peaks().acceleration
    solved = least(motion.peaks, repeats)
    rows = []
    for count in samples:
        time = np.linspace(0, 3, count)
        sampled = np.abs(motion.acceleration(time)).max()
        rows.append((count, abs(sampled / exact - 1), least(lambda t=time: motion.acceleration(t), repeats) / solved))
    return rows


def consecutive_speeds(count, targets=TARGETS, tolerance=5e-3):
    """Return (target, seconds of the first speed on a new mesh, of a further one, of all, peak memory [MB]).

    Each speed has its error estimate, which requires a second mesh, four times as large.
    """
    rows = []
    for target in targets:
        compliance.layer_stiffness.cache_clear()
        compliance.surface_compliance.cache_clear()
        seconds = []
        for velocity in np.geomspace(0.003, 3, count):
            start = perf_counter()
            fem.roll(LAYER, Roller(0.11, **target), MIX, velocity, tolerance=tolerance)
            seconds.append(perf_counter() - start)
        memory = peak_memory("RUSAGE_SELF")
        rows.append((next(iter(target)), seconds[0], float(np.median(seconds[1:])), sum(seconds), memory))
    return rows


def against_plain(tolerances, velocity=0.3):
    """Return (tolerance, unknowns, errors of the resistance of fem and `plain_roll`, seconds) on the mesh of fem.

    Seconds are those of fem with set-up, of fem for a further speed, and of `plain_roll`.
    """
    exact = spectral.roll(LAYER, ROLLER, MIX, velocity, rtol=1e-8).resistance
    rows = []
    for tolerance in tolerances:
        compliance.layer_stiffness.cache_clear()
        compliance.surface_compliance.cache_clear()
        start = perf_counter()
        rolled = fem.roll(LAYER, ROLLER, MIX, velocity, tolerance=tolerance)
        first = perf_counter()
        fem.roll(LAYER, ROLLER, MIX, velocity, tolerance=tolerance)
        further = perf_counter()
        plain = plain_roll(rolled.mesh, ROLLER, MIX, velocity)
        seconds = first - start, further - first, perf_counter() - further
        errors = abs(rolled.resistance / exact - 1), abs(plain / exact - 1)
        rows.append((tolerance, rolled.mesh.dofs, *map(float, errors), *seconds))
    return rows


def plain_roll(rows, roller, mix, speed):
    """Compute the resistance of a bonded layer [N/m], frictionless, parabola: active set of nodes, internal strains.

    The stress is C (e + s (e - z)) with the internal strain z of the one branch, v tau dz/dx = z - e. A fixed-point
    iteration has the instantaneous stiffness on the left and the stress of s z on the right, with one sparse LU
    decomposition for each active set.
    """
    ((share, _),), (lam, mu) = mix.branches, lame_parameters(mix.youngs_modulus, mix.poisson)
    mesh = MeshQuad(np.ascontiguousarray(rows.points.T), np.ascontiguousarray(rows.quads.T))
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=4)
    K = ((1 + share) * asm(linear_elasticity(lam, mu), basis)).tocsc()
    base = basis.get_dofs(lambda x: x[1] < 1e-9).all()
    top = basis.get_dofs(lambda x: x[1] > rows.height * (1 - 1e-9)).all("u^2")
    x = basis.doflocs[0, top]
    depth, internal_strain = roller.indentation - x**2 / (2 * roller.radius), plain_memory(basis, rows, mix, speed)
    stress = LinearForm(lambda v, w: share * ddot(lam * eye(trace(w.z), 2) + 2 * mu * w.z, sym_grad(v)))
    active, solve, u, change = depth > roller.indentation / 2, None, np.zeros(basis.N), np.inf
    while change > 1e-6 * roller.indentation:
        force, previous, converged = asm(stress, basis, z=internal_strain(u)), u, False
        while not converged:
            if solve is None:
                free = np.setdiff1d(np.arange(basis.N), np.concatenate([base, top[active]]))
                solve = splu(K[free][:, free]).solve
            u = np.zeros(basis.N)
            u[top[active]] = -depth[active]
            u[free] = solve((force - K @ u)[free])
            reaction = (force - K @ u)[top]
            updated = np.where(active, reaction > 0, -u[top] < depth)
            converged = np.array_equal(updated, active)
            active, solve = updated, solve if converged else None
        change = np.abs(u - previous).max()
    return float(reaction @ x / roller.radius)


def plain_memory(basis, rows, mix, speed):
    """Return the internal strain z(u) at the quadrature points, for e piecewise linear along their lines."""
    x, y = np.asarray(basis.global_coordinates()).reshape(2, -1)
    lines = np.lexsort((-x, np.round(y / rows.height, 9))).reshape(3 * rows.shape[0], -1)  # downstream
    steps = -np.diff(x[lines], axis=1) / (speed * mix.branches[0][1])
    decay, weight = np.exp(-steps), 1 + np.expm1(-steps) / steps

    def internal_strain(u):
        gradient = np.asarray(basis.interpolate(u).grad)
        strain = ((gradient + gradient.swapaxes(0, 1)) / 2).reshape(4, -1)
        z = strain.copy()
        for k, (old, new) in enumerate(zip(lines.T[:-1], lines.T[1:], strict=True)):
            increment = (1 - decay[:, k] - weight[:, k]) * strain[:, old] + weight[:, k] * strain[:, new]
            z[:, new] = decay[:, k] * z[:, old] + increment
        return z.reshape(gradient.shape)

    return internal_strain


def commands(repeats):
    """Return the seconds of whole processes, and the peak memory of the largest [MB]."""
    with tempfile.TemporaryDirectory() as out:
        calls = {
            "python -c pass": ["-c", "pass"],
            "compact --help": ["-m", "compact.cli", "--help"],
            "compact run": ["-m", "compact.cli", "run", str(SCENE), "--out", out, "--quiet"],
        }

        def run(arguments):
            subprocess.run([sys.executable, *arguments], check=True, capture_output=True)

        seconds = {name: least(lambda a=a: run(a), repeats) for name, a in calls.items()}
    return seconds, peak_memory("RUSAGE_CHILDREN")


def main(
    points=1_000_000,
    repeats=5,
    samples=(100, 1000, 10_000, 100_000),
    speeds=20,
    targets=TARGETS,
    tolerances=(5e-3, 2e-3),
    out=None,
):
    """Return all results by name; `out` is a folder for speed.csv."""
    with Progress() as progress:
        progress.begin("commands")
        seconds, memory = commands(max(1, repeats // 3))  # first, as a child starts with the memory of its parent
        progress.begin("consecutive speeds")
        consecutive = consecutive_speeds(speeds, targets)  # next, while the peak memory is that of the layers
        progress.begin("formulas, laws and plain layers")
        result = {
            "formulas": formulas(points, repeats),
            "laws": laws(points, repeats),
            "peaks": peaks(samples, repeats),
            "consecutive": consecutive,
            "plain": against_plain(tolerances),
            "commands": seconds,
            "memory": memory,
        }
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "speed.csv", ("quantity", "value", "unit"), table(result))
    return result


def table(result):
    """Return the rows (quantity, value, unit) of speed.csv."""
    rows = [(f"eq {name}", rate, "points/s") for name, rate in result["formulas"].items()]
    rows += [(f"law {name}", ratio, "of numpy.polyval") for name, ratio in result["laws"].items()]
    for target, first, further, whole, _ in result["consecutive"]:
        rows += [
            (f"fem {target} {name}", value, "s")
            for name, value in zip(SPEED_NAMES, (first, further, whole), strict=True)
        ]
    for tolerance, _, _, _, _, further, seconds in result["plain"]:
        rows.append((f"plain direct solution at {tolerance:g}", seconds / further, "of a further speed of fem"))
    return rows + [(name, value, "s") for name, value in result["commands"].items()]


def show(result):
    """Print the results of `main`."""
    for name, rate in result["formulas"].items():
        print(f"eq {name:<5}{rate / 1e6:10.1f} million points/s   (goal 10)")
    for name, ratio in result["laws"].items():
        print(f"{name:<12} five derivatives {ratio:5.2f} x numpy.polyval   (goal 5)")
    for count, error, ratio in result["peaks"]:
        print(f"peak by {count:>6} samples: error {error:.1e}, {ratio:7.3f} x the time of the exact roots")
    for target, first, further, whole, memory in result["consecutive"]:
        print(
            f"fem, tolerance 5e-03, {target}: first speed {first:.2f} s (goal 1), a further one {further:.2f} s "
            f"(goal 0.3), all {whole:.1f} s (goal 8), peak memory so far {memory:.0f} MB (goal 500)"
        )
    for tolerance, unknowns, fem_error, plain_error, first, further, seconds in result["plain"]:
        print(
            f"plain direct solution, {unknowns} unknowns: error {plain_error:.1e}, {seconds:.1f} s; fem, tolerance "
            f"{tolerance:.0e}: error {fem_error:.1e}, {seconds / first:.0f} x faster at a first speed, "
            f"{seconds / further:.0f} x at a further one"
        )
    for name, value in result["commands"].items():
        print(f"{name:<16}{value:7.3f} s")
    print(f"peak memory     {result['memory']:7.0f} MB   (goal 300)")


if __name__ == "__main__":
    show(main(out="out/speed_against_plain"))
