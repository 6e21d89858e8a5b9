"""Cost of an error, and the effect of the default settings.

One figure for each benchmark: seconds over the true relative error, one line for each method, the default marked.
Seconds depend on the machine; `work` counts evaluations. Layers: the spectral and the finite-element engine, compared
with the spectral one at a tolerance of 1e-8. Drives: a cart behind a spring by the event-driven integration of this
package and by the solvers of scipy, compared with the closed form of the harmonic law from rest. Maps: contacts that a
resistance map requires for its tolerance. Columns: compared with an integration to 1e-13. Compaction by finite elements
takes minutes and is run on request, `speed_against_error.py compaction`: the published lift from scratch and as a
neighbour 2 % deeper, processor seconds on one core.

    python studies/speed_against_error.py engines

prints the table of the engines in README.md, and writes its numbers to studies/recorded/engines.csv: errors and
processor seconds of contacts of the published machine with the default settings; a minute.
"""

import csv
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time
from timeit import repeat

import numpy as np
from scipy.integrate import solve_ivp

from compact import fem
from compact.engines.column import engine as column
from compact.engines.spectral import engine as spectral
from compact.machine.cart import Cart
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.motion.profile import law
from compact.report.progress import tracked
from compact.resistance import sample_resistance
from compact.rolling_contact import Layer, Roller

LAYER = Layer(0.22)
MIX = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))  # of the published machine
ROLLER = Roller(0.11, indentation=0.003)
THIN_LAYER = Layer(0.1)
COMPACTING = Compaction(
    unloading_modulus=60e6,
    poisson=0.3,
    heckel_slope=13e-6,
    loose_density_ratio=0.72,
    critical_slope=1.2,
    tensile_strength=14e3,
    fed_density_ratio=0.94,
)  # indented by 2 mm
LIFT = Layer(0.062837)  # [m], published lift of 0.06 m after compaction; mix as calibrated in docs/theory/compaction.md
LIFT_ROLLER = Roller(0.11, indentation=0.003, friction=0.35, rolling="free", profile="deformed")
LIFT_MIX = Compaction(
    unloading_modulus=120e6,
    poisson=0.3,
    heckel_slope=16.4518e-6,
    loose_density_ratio=0.72,
    critical_slope=0.993464,
    tensile_strength=14.2815e3,
    fed_density_ratio=0.93576,
)
COMPACTION_SETTINGS = (4, 5, 7, 10)  # [-], elements per contact length
FINEST = 16  # [-], elements per contact length of the reference of compaction, whose own error is about 5e-3
DEEPER = 1.02  # [-], depth of a neighbour over that of the contact from which it starts
STROKE, DURATION = 0.4, 3.0  # [m], [s], of one stroke
CART = Cart(
    mass=1000.0, weight=1e4, roller_positions=(0.0,), roller_reactions=(0.0,), guide_positions=(0.37, -0.37),
    pin_position=0.65, pin_height=0.1, roller_radius=0.11, guide_wheel_diameter=0.046, guide_friction=0.0,
)  # fmt: skip
RECORDED = Path(__file__).parent / "recorded" / "engines.csv"
RECORDED_HEADER = ("engine", "discretisation_error", "least_seconds", "largest_seconds")
ENGINE_WORDS = {  # engine -> model, model error, valid for sizing
    "formula": (
        "equations 1.1-1.10 of the monograph; half-plane theory of Galin and Hertz",
        "unknown; reconstructed from a damaged print (60-95 % confidence)", "at the point of its fit",
    ),
    "column": (
        "irreversible compaction in confined-compression (oedometric) columns; one pass or many",
        "no bow wave: the resistance of a thick layer is a half to a third", "at the point of its fit",
    ),
    "spectral": (
        "viscoelastic layer on a rigid base, steady rolling without friction or with full slip",
        "viscoelastic part only", "no",
    ),
    "fem": (
        "the same layer by plane-strain finite elements; stick and slip of free and driven rollers, fields",
        "viscoelastic part only", "no",
    ),
    "compaction": (
        "irreversible compaction by plane-strain finite elements in finite strain: bow wave, density over the height, "
        "passes",
        "strength of loose mix -37 to +25 % of the resistance of the published machine, pore air, plane strain, "
        "feed",
        "yes",
    ),
}  # fmt: skip
HEADER = ("benchmark", "method", "setting", "relative_error", "seconds", "work")


def timed(solve, repeats):
    """Return the result of `solve`, which is compiled then, and its least seconds."""
    return solve(), min(repeat(solve, number=1, repeat=repeats))


def layers(settings, repeats):
    """Tolerance of an engine: largest error of the resistance over ten speeds, seconds per speed, contact nodes."""
    velocities = np.geomspace(0.003, 3, 10)

    def rolled(method, tolerance):
        engine, keyword = {"spectral": (spectral, "rtol"), "fem": (fem, "tolerance")}[method]
        return [engine.roll(LAYER, ROLLER, MIX, v, **{keyword: tolerance}) for v in velocities]

    exact = np.array([found.resistance for found in rolled("spectral", 1e-8)])
    for method, tolerance in settings:
        found, seconds = timed(lambda m=method, t=tolerance: rolled(m, t), repeats)
        error = np.abs([each.resistance for each in found] / exact - 1).max()
        yield method, tolerance, error, seconds / len(velocities), sum(len(each.x) for each in found)


def drives(settings, repeats, stiffness=1e6, ratio=0.05):
    """Tolerance of a method: largest error of the position over the stroke in a cycle from rest, evaluated rates.

    The driven end moves by y = (h/2) (1 - cos W t), W = pi/T; m x'' + c (x' - y') + k (x - y) = 0 has a closed form.
    """
    damping, omega = 2 * ratio * np.sqrt(stiffness * CART.mass), np.pi / DURATION
    time = np.linspace(0, 2 * DURATION, 501)
    exact = harmonic_response(time, np.sqrt(stiffness / CART.mass), ratio, omega)
    cycle, drive = law("harmonic", STROKE, DURATION).cycle(), ElasticDrive(stiffness, damping)

    def rates(t, z):
        driven_end, speed = STROKE / 2 * (1 - np.cos(omega * t)), STROKE / 2 * omega * np.sin(omega * t)
        return [z[1], (stiffness * (driven_end - z[0]) + damping * (speed - z[1])) / CART.mass]

    def solved(method, tolerance):
        if method == "compact":
            spring = replace(drive, tolerance=tolerance)
            run = simulate_elastic(CART, spring, cycle, lambda v, a: np.zeros_like(v), regime="rest")
            return run.trajectory.at(time).position, run.cost.evaluations
        solution = solve_ivp(
            rates, (0, 2 * DURATION), [0.0, 0.0], method, time, rtol=tolerance, atol=tolerance * STROKE
        )
        return solution.y[0], solution.nfev

    for method, tolerance in settings:
        (position, work), seconds = timed(lambda m=method, t=tolerance: solved(m, t), repeats)
        yield method, tolerance, np.abs(position - exact).max() / STROKE, seconds, work


def harmonic_response(time, natural, ratio, omega):
    """Return x(t) from rest: transfer function H = (w^2 + 2 i z w W)/(w^2 - W^2 + 2 i z w W), plus free vibration."""
    numerator = natural**2 + 2j * ratio * natural * omega
    H = numerator / (numerator - omega**2)
    decay, damped = ratio * natural, natural * np.sqrt(1 - ratio**2)
    A = STROKE / 2 * (H.real - 1)
    B = (STROKE / 2 * (1j * omega * H).real + decay * A) / damped
    steady = STROKE / 2 * (1 - (H * np.exp(1j * omega * time)).real)
    return steady + np.exp(-decay * time) * (A * np.cos(damped * time) + B * np.sin(damped * time))


def maps(settings, _):
    """Tolerance of a map by the spectral engine: largest error over the largest force, contacts."""

    def force(speed):
        rolled = spectral.roll(LAYER, ROLLER, MIX, speed)
        return rolled.resistance, rolled.error[1]

    speeds = np.geomspace(0.002, 1.0, 60)
    exact = np.array([force(speed)[0] for speed in speeds])
    for method, tolerance in settings:
        found, seconds = timed(lambda t=tolerance: sample_resistance(force, 0.02, 1.0, t), 1)
        yield method, tolerance, np.abs(found(speeds) - exact).max() / exact.max(), seconds, len(found.speeds)


def columns(settings, repeats):
    """Tolerance of a step: error of the resistance of a pass, evaluations of the rates."""
    roller = Roller(0.11, indentation=0.002, profile="circle")
    exact = column.roll(THIN_LAYER, roller, COMPACTING, 0.2, rtol=1e-13).resistance
    for method, rtol in settings:
        found, seconds = timed(lambda r=rtol: column.roll(THIN_LAYER, roller, COMPACTING, 0.2, rtol=r), repeats)
        yield method, rtol, abs(found.resistance / exact - 1), seconds, found.own["evaluations"]


def compactions(settings, _):
    """Elements per contact length: larger error of load and resistance to FINEST, processor seconds, steps.

    A contact from scratch is compared with one from scratch. A neighbour, DEEPER from the contact of the same mesh, is
    compared with the finest contact at its depth from scratch.
    """
    from compact.engines.compaction import engine as compaction

    def rolled(increments, deeper=1.0, start=None):
        begin = process_time()
        roller = replace(LIFT_ROLLER, indentation=deeper * LIFT_ROLLER.indentation)
        found = compaction.roll(LIFT, roller, LIFT_MIX, 0.2, increments=increments, start=start)
        return found, process_time() - begin

    def error(found, exact):
        return max(abs(found.load / exact.load - 1), abs(found.resistance / exact.resistance - 1))

    rolled(4)  # compiles
    exact = {deeper: rolled(FINEST, deeper)[0] for deeper in (1.0, DEEPER)}
    contacts = {}
    for method, increments in settings:
        if increments not in contacts:
            contacts[increments] = rolled(increments)
        found, seconds = contacts[increments]
        deeper = 1.0
        if method == "neighbour":
            deeper = DEEPER
            found, seconds = rolled(increments, DEEPER, found)
        yield method, increments, error(found, exact[deeper]), seconds, len(found.solution.steps)


def engines():
    """Largest error of the resistance, and least and largest processor seconds of a contact, of every engine.

    Layered engines are compared with a tolerance of 1e-8 (linear) and steps of 1e-13 (columns); the error of compaction
    is its own estimate, that of the worse of load and resistance. The formula has no error.
    """
    from compact.engines import formula
    from compact.engines.compaction import engine as compaction

    speeds = np.geomspace(0.03, 0.45, 4)
    pressed = replace(ROLLER, indentation=0.002, profile="circle")
    loaded = Roller(0.11, peak_pressure=0.203e6, friction=0.35, rolling="free")
    secant = Elastic(youngs_modulus=0.75e6, poisson=0.3)
    cases = {  # engine -> contact at a speed, and its exact resistance or none
        "formula": (lambda v: formula.roll(LAYER, loaded, secant, v), None),
        "column": (
            lambda v: column.roll(THIN_LAYER, pressed, COMPACTING, v),
            lambda v: column.roll(THIN_LAYER, pressed, COMPACTING, v, rtol=1e-13).resistance,
        ),
        "spectral": (
            lambda v: spectral.roll(LAYER, ROLLER, MIX, v, rtol=1e-2),
            lambda v: spectral.roll(LAYER, ROLLER, MIX, v, rtol=1e-8).resistance,
        ),
        "fem": (
            lambda v: fem.roll(LAYER, ROLLER, MIX, v, tolerance=1e-2),
            lambda v: spectral.roll(LAYER, ROLLER, MIX, v, rtol=1e-8).resistance,
        ),
        "compaction": (lambda v: compaction.roll(LIFT, LIFT_ROLLER, LIFT_MIX, v), None),
    }
    for name, (rolled, exact) in cases.items():
        at, seconds, errors = speeds if name != "compaction" else speeds[-1:], [], []
        rolled(at[0])  # compiles, and fills the caches of a first contact
        for v in at:
            begin = process_time()
            found = rolled(v)
            seconds.append(process_time() - begin)
            if exact is not None:
                errors.append(abs(found.resistance / exact(v) - 1))
            elif name == "compaction":
                errors.append(max(found.error))
        yield name, max(errors, default=0.0), min(seconds), max(seconds)


def engine_table(rows):
    """Return the table of engines in Markdown from the rows of `engines`."""
    lines = [
        "| engine | model | discretisation error | model error | for sizing? | time of one contact |",
        "|---|---|---|---|---|---|",
    ]
    for name, error, low, high in rows:
        model, model_error, sizing = ENGINE_WORDS[name]
        size = _error_words(name, error)
        lines.append(f"| `{name}` | {model} | {size} | {model_error} | {sizing} | {_time_words(low, high)} |")
    return "\n".join(lines)


def _error_words(name, error):
    if name == "formula":
        return "none, closed form"
    return "below 0.1 %" if error < 1e-3 else f"{100 * error:.1g} %"


def _time_words(low, high):
    """Return one or two seconds with one digit, such as 10-60 ms."""
    unit, factor = ("s", 1.0) if high >= 0.95 else ("ms", 1e3) if high >= 0.95e-4 else ("µs", 1e6)
    low, high = (float(f"{factor * each:.1g}") for each in (low, high))
    return f"{low:g} {unit}" if low == high else f"{low:g}-{high:g} {unit}"


def read_recorded():
    """Return the recorded rows of `engines`."""
    with RECORDED.open(newline="", encoding="utf-8") as file:
        return [(name, *map(float, values)) for name, *values in list(csv.reader(file))[1:]]


@dataclass(frozen=True)
class Benchmark:
    """One figure.

    rows : generator of (method, setting, error, least seconds, work) for settings and a number of repeats
    settings : methods and settings of the full figure
    defaults : defaults of the package; 0.01 is the tolerance of the scenes
    error : quantity of the error
    """

    rows: Callable
    settings: tuple
    defaults: tuple
    error: str


def settings_of(method, *values):
    """Pair a method with each of its settings."""
    return tuple((method, value) for value in values)


BENCHMARKS = {
    "layers": Benchmark(
        layers,
        settings_of("spectral", 1e-2, 1e-3, 1e-4, 1e-5, 1e-6) + settings_of("fem", 1e-2, 5e-3, 2e-3, 5e-4),
        (("spectral", 1e-2), ("fem", 1e-2)),
        "resistance, largest of ten speeds",
    ),
    "drives": Benchmark(
        drives,
        sum(
            (settings_of(name, 1e-4, 1e-6, 1e-8, 1e-10) for name in ("compact", "RK45", "DOP853", "Radau", "LSODA")), ()
        ),
        (("compact", 1e-8),),
        "position over the stroke",
    ),
    "maps": Benchmark(
        maps, settings_of("map", 1e-1, 3e-2, 1e-2, 3e-3, 1e-3), (("map", 1e-2),), "force over the largest force"
    ),
    "columns": Benchmark(
        columns, settings_of("column", 1e-3, 1e-5, 1e-7, 1e-9, 1e-11), (("column", 1e-9),), "resistance"
    ),
    "compaction": Benchmark(
        compactions,
        settings_of("from scratch", *COMPACTION_SETTINGS) + settings_of("neighbour", *COMPACTION_SETTINGS),
        (("from scratch", 7), ("neighbour", 7)),
        f"load or resistance, to {FINEST} elements per contact length",
    ),
}
QUICK = ("layers", "drives", "maps", "columns")


def main(benchmarks=QUICK, repeats=3, out=None, **settings):
    """Return rows by benchmark; `out` is a folder for table and figures, `settings` replace those of a benchmark."""
    results = {
        name: [tuple(row) for row in BENCHMARKS[name].rows(settings.get(name, BENCHMARKS[name].settings), repeats)]
        for name in tracked(benchmarks, str)
    }
    if out:
        from compact.files import write_csv

        rows = [(name, *row) for name, found in results.items() for row in found]
        write_csv(Path(out) / "speed_against_error.csv", HEADER, rows)
        for name, found in results.items():
            draw(BENCHMARKS[name], found).savefig(Path(out) / f"{name}.png", dpi=110)
    return results


def draw(benchmark, rows):
    """Draw seconds over the error, one line for each method, the default marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    ax = figure.subplots()
    for method in dict.fromkeys(row[0] for row in rows):
        settings, errors, seconds = np.array([row[1:4] for row in rows if row[0] == method]).T
        line = ax.loglog(np.maximum(errors, 1e-16), seconds, "o-", markersize=4, label=method)[0]
        for setting, error, second in zip(settings, np.maximum(errors, 1e-16), seconds, strict=True):
            ax.annotate(f"{setting:g}", (error, second), fontsize=7, xytext=(3, 3), textcoords="offset points")
            if (method, setting) in benchmark.defaults:
                ax.plot(error, second, "o", markersize=13, fillstyle="none", color=line.get_color())
    low, high = ax.get_ylim()
    ax.set_ylim(low / 2, 2 * high)  # at least a factor of four, so that equal costs look equal
    ax.set(xlabel=f"true relative error: {benchmark.error}", ylabel="time on this machine [s]")
    ax.legend(frameon=False, fontsize=8, title="numbers: setting; circled: default", title_fontsize=8)
    return figure


def show(results):
    """Print the rows of `main`, the defaults marked."""
    for name, rows in results.items():
        print(f"{name}: error of {BENCHMARKS[name].error}")
        for method, setting, error, seconds, work in rows:
            mark = "  default" if (method, setting) in BENCHMARKS[name].defaults else ""
            print(f"    {method:<14}{setting:<8g}{error:9.1e}{seconds * 1e3:12.2f} ms{work:9d}{mark}")


if __name__ == "__main__":
    if sys.argv[1:] == ["engines"]:
        from compact.files import write_csv

        write_csv(RECORDED, RECORDED_HEADER, [(name, *(f"{each:.3g}" for each in row)) for name, *row in engines()])
        print(engine_table(read_recorded()))
    else:
        show(main(sys.argv[1:] or QUICK, out="out/speed_against_error"))
