"""How fast is each method, against a plain baseline timed in the same run?

Ratios count, seconds belong to the machine. Formulas: points per second over arrays in which every argument varies.
Layers: error against tolerance and time of the spectral and the finite-element engine; what a first speed, a further
one and twenty cost by finite elements; and the plain direct solve that anybody would write, on the same mesh. Laws:
position to snap at many instants against one numpy.polyval of the law's degree per derivative. Peaks: error of sampling
a law at n instants against the roots that `peaks` solves for. Drive: a cart behind a spring by our arcs and by scipy's
solvers, against the closed form of the harmonic law from rest. Map: contacts that a resistance map takes for its
tolerance. Columns and, on demand, compaction by finite elements. Command: whole processes. One figure per question, the
default marked.
"""

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse.linalg import splu
from skfem import Basis, ElementQuad2, ElementVector, LinearForm, MeshQuad, asm
from skfem.helpers import ddot, eye, sym_grad, trace
from skfem.models.elasticity import lame_parameters, linear_elasticity

from compact import column, compliance, contact, fem, spectral
from compact.cart import Cart
from compact.elastic import ElasticDrive, travel
from compact.material import Compaction, Viscoelastic
from compact.motion import law
from compact.records import Layer, Roller
from compact.resistance import sampled

SCENE = Path(__file__).parent / "scenes" / "loveikin-2015.toml"
LAYER, MIX = Layer(0.22), Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))  # that of the published machine
PRESSED = Roller(0.11, indentation=0.003)
TARGETS = ({"indentation": 0.003}, {"load": 15e3}, {"peak_pressure": 0.7e6})
PRESSABLE = Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)  # fed at 0.94, a layer of 0.1 m pressed by 2 mm
DEFAULTS = {  # methods and settings that the package takes, by question; 0.01 is the tolerance of the scenes
    "layers": (("spectral", 1e-2), ("fem", 1e-2)),
    "drives": (("ours", 1e-8),),
    "maps": (("map", 1e-2),),
    "columns": (("column", 1e-9),),
    "compaction": (("compaction", 12),),
}
STRETCH, PASS = 0.4, 3.0  # stroke [m] and time of a pass [s]
LAW_DEGREES = {"quintic": 5, "septic": 7, "reversal-4": 7, "combined-4": 7}


def fastest(work, repeats):
    """Least seconds of several calls."""
    seconds = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        seconds.append(perf_counter() - start)
    return min(seconds)


def formula_calls(points, rng=None):
    """Eqs 1.1-1.10 as calls on arrays of so many points, every argument an array."""
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
    """Points per second of each formula."""
    return {name: points / fastest(call, repeats) for name, call in formula_calls(points).items()}


def laws(points, repeats):
    """Seconds of five derivatives over seconds of as many numpy.polyval of the degree that is left."""
    time = np.linspace(0, 3, points)
    ratios = {}
    for name, degree in LAW_DEGREES.items():
        motion, coefficients = law(name, 0.4, 3.0), np.arange(degree + 1.0)
        ours = fastest(lambda motion=motion: [motion.derivative(time, k) for k in range(5)], repeats)
        plain = fastest(lambda c=coefficients: [np.polyval(c[k:], time) for k in range(5)], repeats)
        ratios[name] = ours / plain
    return ratios


def peaks(samples, repeats):
    """(instants, relative error, seconds over those of `peaks`) of the peak acceleration by sampling."""
    motion = law("combined-4", 0.4, 3.0)
    exact = motion.peaks().acceleration
    solved = fastest(motion.peaks, repeats)
    rows = []
    for count in samples:
        time = np.linspace(0, 3, count)
        sampled = np.abs(motion.acceleration(time)).max()
        rows.append((count, abs(sampled / exact - 1), fastest(lambda t=time: motion.acceleration(t), repeats) / solved))
    return rows


def layer_engines(settings, repeats):
    """(engine, tolerance, worst true relative error of the resistance, mean seconds a speed) over ten speeds.

    The judge is the spectral engine at a tolerance of 1e-8. Finite elements pay for a mesh once, which the first of the
    repeats does.
    """
    velocities = np.geomspace(0.003, 3, 10)

    def resistances(engine, **numerics):
        return np.array([engine.roll(LAYER, PRESSED, MIX, v, **numerics).resistance for v in velocities])

    exact = resistances(spectral, rtol=1e-8)
    rows = []
    for name, tolerance in settings:
        engine, keyword = {"spectral": (spectral, "rtol"), "fem": (fem, "tolerance")}[name]
        found = resistances(engine, **{keyword: tolerance})
        seconds = fastest(lambda e=engine, k=keyword, t=tolerance: resistances(e, **{k: t}), repeats) / len(velocities)
        rows.append((name, tolerance, float(np.abs(found / exact - 1).max()), seconds))
    return rows


def speeds_in_a_row(count, targets=TARGETS, tolerance=5e-3):
    """(target, seconds of the first speed on a new mesh, of a further one, of all of them, peak memory [MB]).

    Each with its error told, which takes a second mesh, four times as large.
    """
    rows = []
    for target in targets:
        compliance.stiffness.cache_clear()
        compliance.condensed.cache_clear()
        seconds = []
        for velocity in np.geomspace(0.003, 3, count):
            start = perf_counter()
            fem.roll(LAYER, Roller(0.11, **target), MIX, velocity, tolerance=tolerance)
            seconds.append(perf_counter() - start)
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        rows.append((next(iter(target)), seconds[0], float(np.median(seconds[1:])), sum(seconds), memory))
    return rows


def against_plain(tolerances, velocity=0.3):
    """(tolerance, unknowns, errors of the resistance of fem and of `plain_roll`, their seconds) on the mesh of fem.

    Seconds of fem come twice: with set-up, and for a further speed.
    """
    exact = spectral.roll(LAYER, PRESSED, MIX, velocity, rtol=1e-8).resistance
    rows = []
    for tolerance in tolerances:
        compliance.stiffness.cache_clear()
        compliance.condensed.cache_clear()
        start = perf_counter()
        rolled = fem.roll(LAYER, PRESSED, MIX, velocity, tolerance=tolerance)
        first = perf_counter()
        fem.roll(LAYER, PRESSED, MIX, velocity, tolerance=tolerance)
        further = perf_counter()
        plain = plain_roll(rolled.mesh, PRESSED, MIX, velocity)
        seconds = first - start, further - first, perf_counter() - further
        errors = abs(rolled.resistance / exact - 1), abs(plain / exact - 1)
        rows.append((tolerance, rolled.mesh.dofs, *map(float, errors), *seconds))
    return rows


def plain_roll(rows, roller, mix, speed):
    """Resistance of a bonded layer [N/m], frictionless, parabola: nodes that touch, and strains that are remembered.

    Stress is C (e + s (e - z)) with the strain z that the one branch remembers, v tau dz/dx = z - e. Instant stiffness
    on the left, stress of s z on the right, in turn until the surface rests; a sparse LU for each set of nodes.
    """
    ((share, _),), (lam, mu) = mix.branches, lame_parameters(mix.youngs_modulus, mix.poisson)
    mesh = MeshQuad(np.ascontiguousarray(rows.points.T), np.ascontiguousarray(rows.quads.T))
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=4)
    K = ((1 + share) * asm(linear_elasticity(lam, mu), basis)).tocsc()
    base = basis.get_dofs(lambda x: x[1] < 1e-9).all()
    top = basis.get_dofs(lambda x: x[1] > rows.height * (1 - 1e-9)).all("u^2")
    x = basis.doflocs[0, top]
    depth, remember = roller.indentation - x**2 / (2 * roller.radius), plain_memory(basis, rows, mix, speed)
    stress = LinearForm(lambda v, w: share * ddot(lam * eye(trace(w.z), 2) + 2 * mu * w.z, sym_grad(v)))
    touching, solve, u, moved = depth > roller.indentation / 2, None, np.zeros(basis.N), np.inf
    while moved > 1e-6 * roller.indentation:
        force, before, settled = asm(stress, basis, z=remember(u)), u, False
        while not settled:
            if solve is None:
                free = np.setdiff1d(np.arange(basis.N), np.concatenate([base, top[touching]]))
                solve = splu(K[free][:, free]).solve
            u = np.zeros(basis.N)
            u[top[touching]] = -depth[touching]
            u[free] = solve((force - K @ u)[free])
            reaction = (force - K @ u)[top]
            pressed = np.where(touching, reaction > 0, -u[top] < depth)
            settled = np.array_equal(pressed, touching)
            touching, solve = pressed, solve if settled else None
        moved = np.abs(u - before).max()
    return float(reaction @ x / roller.radius)


def plain_memory(basis, rows, mix, speed):
    """z of displacements u at the quadrature points, with e piecewise linear along their lines."""
    x, y = np.asarray(basis.global_coordinates()).reshape(2, -1)
    lines = np.lexsort((-x, np.round(y / rows.height, 9))).reshape(3 * rows.shape[0], -1)  # downstream
    steps = -np.diff(x[lines], axis=1) / (speed * mix.branches[0][1])
    decay, newer = np.exp(-steps), 1 + np.expm1(-steps) / steps

    def remember(u):
        gradient = np.asarray(basis.interpolate(u).grad)
        strain = ((gradient + gradient.swapaxes(0, 1)) / 2).reshape(4, -1)
        z = strain.copy()
        for k, (old, new) in enumerate(zip(lines.T[:-1], lines.T[1:], strict=True)):
            gained = (1 - decay[:, k] - newer[:, k]) * strain[:, old] + newer[:, k] * strain[:, new]
            z[:, new] = decay[:, k] * z[:, old] + gained
        return z.reshape(gradient.shape)

    return remember


def drives(settings, stiffness=1e6, ratio=0.05):
    """(method, tolerance, largest error of the position over the stroke, seconds, rates asked) from rest over a cycle.

    The far end goes as y = (h/2) (1 - cos W t), W = pi/T, and m x'' + c (x' - y') + k (x - y) = 0 has a closed form.
    """
    damping, omega = 2 * ratio * np.sqrt(stiffness * CARRIED.mass), np.pi / PASS
    time = np.linspace(0, 2 * PASS, 501)
    exact = harmonic_response(time, np.sqrt(stiffness / CARRIED.mass), ratio, omega)
    cycle, drive = law("harmonic", STRETCH, PASS).cycle(), ElasticDrive(stiffness, damping)

    def rates(t, z):
        far, speed = STRETCH / 2 * (1 - np.cos(omega * t)), STRETCH / 2 * omega * np.sin(omega * t)
        return [z[1], (stiffness * (far - z[0]) + damping * (speed - z[1])) / CARRIED.mass]

    def solved(method, tolerance):
        if method == "ours":
            run = travel(CARRIED, drive, cycle, lambda v, a: np.zeros_like(v), regime="rest", tolerance=tolerance)
            return run.course.motion(*run.course.at(time))[0], run.work.evaluations
        got = solve_ivp(rates, (0, 2 * PASS), [0.0, 0.0], method, time, rtol=tolerance, atol=tolerance * STRETCH)
        return got.y[0], got.nfev

    rows = []
    for method, tolerance in settings:
        solved(method, tolerance)  # compiles
        (position, work), seconds = solved(method, tolerance), fastest(lambda m=method, t=tolerance: solved(m, t), 3)
        rows.append((method, tolerance, float(np.abs(position - exact).max() / STRETCH), seconds, work))
    return rows


CARRIED = Cart(
    mass=1000.0, weight=1e4, roller_positions=(0.0,), roller_reactions=(0.0,), guide_positions=(0.37, -0.37),
    pin_position=0.65, pin_height=0.1, roller_radius=0.11, guide_wheel_diameter=0.046, guide_friction=0.0,
)  # fmt: skip


def harmonic_response(time, natural, ratio, omega):
    """x(t) from rest: H = (w^2 + 2 i z w W)/(w^2 - W^2 + 2 i z w W) for the far end, and the ringing that it leaves."""
    pull = natural**2 + 2j * ratio * natural * omega
    H = pull / (pull - omega**2)
    fading, ringing = ratio * natural, natural * np.sqrt(1 - ratio**2)
    A = STRETCH / 2 * (H.real - 1)
    B = (STRETCH / 2 * (1j * omega * H).real + fading * A) / ringing
    steady = STRETCH / 2 * (1 - (H * np.exp(1j * omega * time)).real)
    return steady + np.exp(-fading * time) * (A * np.cos(ringing * time) + B * np.sin(ringing * time))


def maps(tolerances):
    """(tolerance, largest true error over the largest force, seconds, contacts) of a map, by the spectral engine."""

    def force(speed):
        rolled = spectral.roll(LAYER, PRESSED, MIX, speed)
        return rolled.resistance, rolled.error[1]

    speeds = np.geomspace(0.002, 1.0, 60)
    exact = np.array([force(speed)[0] for speed in speeds])
    rows = []
    for tolerance in tolerances:
        start = perf_counter()
        found = sampled(force, 0.02, 1.0, tolerance)
        seconds = perf_counter() - start
        rows.append((
            "map", tolerance, float(np.abs(found(speeds) - exact).max() / exact.max()), seconds, len(found.speeds)
        ))  # fmt: skip
    return rows


def columns(tolerances, repeats):
    """(tolerance, relative error of the resistance, seconds, evaluations) of a pass pressed by columns."""
    layer, roller = Layer(0.1), Roller(0.11, indentation=0.002, profile="circle")
    exact = column.roll(layer, roller, PRESSABLE, 0.2, rtol=1e-13).resistance
    rows = []
    for rtol in tolerances:
        found = column.roll(layer, roller, PRESSABLE, 0.2, rtol=rtol)
        seconds = fastest(lambda r=rtol: column.roll(layer, roller, PRESSABLE, 0.2, rtol=r), repeats)
        rows.append(("column", rtol, abs(found.resistance / exact - 1), seconds, found.evaluations))
    return rows


def compactions(increments, finest=18):
    """(increments, relative error of the resistance, seconds, unknowns) by finite elements, a minute or more for each.

    The judge has `finest` increments per contact length, and an error of its own of about 5e-3.
    """
    from compact import compaction

    layer, roller = Layer(0.1), Roller(0.11, indentation=0.002, profile="deformed")
    exact = compaction.roll(layer, roller, PRESSABLE, 0.2, increments=finest).resistance if increments else None
    rows = []
    for count in increments:
        start = perf_counter()
        found = compaction.roll(layer, roller, PRESSABLE, 0.2, increments=count)
        seconds = perf_counter() - start
        rows.append(("compaction", count, abs(found.resistance / exact - 1), seconds, len(found.steps)))
    return rows


def commands(repeats):
    """Seconds of whole processes, and the peak memory of the largest [MB]."""
    with tempfile.TemporaryDirectory() as out:
        calls = {
            "python -c pass": ["-c", "pass"],
            "compact --help": ["-m", "compact.cli", "--help"],
            "compact run": ["-m", "compact.cli", "run", str(SCENE), "--out", out, "--quiet"],
        }

        def run(arguments):
            subprocess.run([sys.executable, *arguments], check=True, capture_output=True)

        seconds = {name: fastest(lambda a=a: run(a), repeats) for name, a in calls.items()}
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


SETTINGS = (
    *(("spectral", error) for error in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)),
    *(("fem", error) for error in (1e-2, 5e-3, 2e-3, 5e-4)),
)


METHODS = tuple(
    (method, tolerance)
    for method in ("ours", "RK45", "DOP853", "Radau", "LSODA")
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10)
)


def main(
    points=1_000_000,
    repeats=5,
    samples=(100, 1000, 10_000, 100_000),
    settings=SETTINGS,
    speeds=20,
    targets=TARGETS,
    plain=(5e-3, 2e-3),
    methods=METHODS,
    tolerances=(1e-1, 3e-2, 1e-2, 3e-3, 1e-3),
    rtols=(1e-3, 1e-5, 1e-7, 1e-9, 1e-11),
    increments=(),
    out=None,
):
    """All figures; `out` names a directory for speed.csv and a figure for each question.

    increments : of compaction by finite elements, such as (6, 12), minutes; left out unless given
    """
    seconds, memory = commands(max(1, repeats // 3))  # first, as a child starts with the memory of its parent
    in_a_row = speeds_in_a_row(speeds, targets)  # next, while the peak of memory is its own
    result = {
        "formulas": formulas(points, repeats),
        "laws": laws(points, repeats),
        "peaks": peaks(samples, repeats),
        "layers": layer_engines(settings, max(1, repeats // 2)),
        "in a row": in_a_row,
        "plain": against_plain(plain),
        "drives": drives(methods),
        "maps": maps(tolerances),
        "columns": columns(rtols, repeats),
        "compaction": compactions(increments),
        "commands": seconds,
        "memory": memory,
    }
    if out:
        from compact.results import write_csv

        write_csv(Path(out) / "speed.csv", ("what", "value", "unit"), table(result))
        write_csv(Path(out) / "speed_against_error.csv", AGAINST, against(result))
        for question in DEFAULTS:
            if result[question]:
                draw(question, result[question]).savefig(Path(out) / f"{question}.png", dpi=110)
    return result


def table(result):
    """(what, value, unit) of the figures, for speed.csv."""
    rows = [(f"eq {name}", rate, "points/s") for name, rate in result["formulas"].items()]
    rows += [(f"law {name}", ratio, "of numpy.polyval") for name, ratio in result["laws"].items()]
    for target, first, further, whole, _ in result["in a row"]:
        rows += [(f"fem {target} {name}", value, "s") for name, value in zip(ROW, (first, further, whole), strict=True)]
    for tolerance, _, _, _, _, further, seconds in result["plain"]:
        rows.append((f"plain direct solve at {tolerance:g}", seconds / further, "of a further speed of fem"))
    return rows + [(name, value, "s") for name, value in result["commands"].items()]


AGAINST = ("question", "method", "setting", "relative_error", "seconds", "work")


def against(result):
    """Rows of AGAINST, for every question that has a figure."""
    return [(question, *row, *[""] * (5 - len(row))) for question in DEFAULTS for row in result[question]]


def draw(question, rows):
    """Seconds over the error, a line for each method, the default ringed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    ax = figure.subplots()
    for method in dict.fromkeys(row[0] for row in rows):
        settings, errors, seconds = np.array([row[1:4] for row in rows if row[0] == method]).T
        line = ax.loglog(np.maximum(errors, 1e-16), seconds, "o-", markersize=4, label=method)[0]
        for setting, error, second in zip(settings, np.maximum(errors, 1e-16), seconds, strict=True):
            ax.annotate(f"{setting:g}", (error, second), fontsize=7, xytext=(3, 3), textcoords="offset points")
            if (method, setting) in DEFAULTS[question]:
                ax.plot(error, second, "o", markersize=13, fillstyle="none", color=line.get_color())
    low, high = ax.get_ylim()
    ax.set_ylim(low / 2, 2 * high)  # so that what costs the same looks it
    ax.set(xlabel=f"true relative error: {ERRORS[question]}", ylabel="seconds, this machine")
    ax.legend(frameon=False, fontsize=8, title="labels: setting; ringed: default", title_fontsize=8)
    return figure


ERRORS = {
    "layers": "resistance, worst of ten speeds",
    "drives": "position over the stroke",
    "maps": "force over its largest",
    "columns": "resistance",
    "compaction": "resistance, against 18 increments",
}
ROW = ("first speed", "further speed", "all speeds")


def show(result):
    """Print the figures of `main`."""
    for name, rate in result["formulas"].items():
        print(f"eq {name:<5}{rate / 1e6:10.1f} million points/s   (goal 10)")
    for name, ratio in result["laws"].items():
        print(f"{name:<12} five derivatives {ratio:5.2f} x numpy.polyval   (goal 5)")
    for count, error, ratio in result["peaks"]:
        print(f"peak by {count:>6} samples: error {error:.1e}, {ratio:7.3f} x the time of the exact roots")
    for engine, tolerance, error, seconds in result["layers"]:
        goal = {"spectral": 30, "fem": 300}[engine]
        print(f"{engine:<9} asked {tolerance:.0e}: error {error:.1e}, {seconds * 1e3:6.1f} ms a speed   (goal {goal})")
    for target, first, further, whole, memory in result["in a row"]:
        print(
            f"fem asked 5e-03, {target}: first speed {first:.2f} s (goal 1), a further one {further:.2f} s (goal 0.3), "
            f"all {whole:.1f} s (goal 8), peak memory so far {memory:.0f} MB (goal 500)"
        )
    for tolerance, unknowns, ours, theirs, first, further, seconds in result["plain"]:
        print(
            f"plain direct solve, {unknowns} unknowns: error {theirs:.1e}, {seconds:.1f} s; fem asked {tolerance:.0e}: "
            f"error {ours:.1e}, a first speed {seconds / first:.0f} x faster, a further one {seconds / further:.0f} x"
        )
    for question in ("drives", "maps", "columns", "compaction"):
        for method, setting, error, seconds, work in result[question]:
            print(f"{method:<11}{setting:<8g}: error {error:.1e}, {seconds * 1e3:9.2f} ms, work {work}")
    for name, value in result["commands"].items():
        print(f"{name:<16}{value:7.3f} s")
    print(f"peak memory     {result['memory']:7.0f} MB   (goal 300)")


if __name__ == "__main__":
    show(main(increments=(6, 12) if "compaction" in sys.argv else (), out="out/speed_against_error"))
