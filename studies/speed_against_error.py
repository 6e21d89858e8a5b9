"""Cost of an error, and the effect of the default settings.

One figure for each question: seconds over the true relative error, one line for each method, the default marked.
Seconds depend on the machine; `work` counts evaluations. Layers: the spectral and the finite-element engine, compared
with the spectral one at a tolerance of 1e-8. Drives: a cart behind a spring by our event-driven integration and by the
solvers of scipy, compared with the closed form of the harmonic law from rest. Maps: contacts that a resistance map
requires for its tolerance. Columns, compared with an integration to 1e-13. Compaction by finite elements, minutes, on
request: `speed_against_error.py compaction`.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from timeit import repeat

import numpy as np
from scipy.integrate import solve_ivp

from compact import fem
from compact.engines.column import engine as column
from compact.engines.spectral import engine as spectral
from compact.machine.cart import Cart
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.material.laws import Compaction, Viscoelastic
from compact.motion.profile import law
from compact.report.progress import tracked
from compact.resistance import sample_resistance
from compact.rolling_contact import Layer, Roller

LAYER, MIX = Layer(0.22), Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))  # that of the published machine
PRESSED = Roller(0.11, indentation=0.003)
THIN, PRESSABLE = Layer(0.1), Compaction(60e6, 0.3, 13e-6, 0.72, 1.2, 14e3, 0.94)  # pressed by 2 mm
FINEST = 18  # increments per contact length of the judge of compaction, whose own error is about 5e-3
STRETCH, PASS = 0.4, 3.0  # stroke [m] and time of a pass [s]
CARRIED = Cart(
    mass=1000.0, weight=1e4, roller_positions=(0.0,), roller_reactions=(0.0,), guide_positions=(0.37, -0.37),
    pin_position=0.65, pin_height=0.1, roller_radius=0.11, guide_wheel_diameter=0.046, guide_friction=0.0,
)  # fmt: skip
HEADER = ("question", "method", "setting", "relative_error", "seconds", "work")


def timed(solve, repeats):
    """Result of `solve` after compilation, and its least seconds."""
    return solve(), min(repeat(solve, number=1, repeat=repeats))


def layers(settings, repeats):
    """Tolerance of an engine: worst error of the resistance over ten speeds, seconds a speed, nodes of the contacts."""
    velocities = np.geomspace(0.003, 3, 10)

    def rolled(method, tolerance):
        engine, keyword = {"spectral": (spectral, "rtol"), "fem": (fem, "tolerance")}[method]
        return [engine.roll(LAYER, PRESSED, MIX, v, **{keyword: tolerance}) for v in velocities]

    exact = np.array([found.resistance for found in rolled("spectral", 1e-8)])
    for method, tolerance in settings:
        found, seconds = timed(lambda m=method, t=tolerance: rolled(m, t), repeats)
        error = np.abs([each.resistance for each in found] / exact - 1).max()
        yield method, tolerance, error, seconds / len(velocities), sum(len(each.x) for each in found)


def drives(settings, repeats, stiffness=1e6, ratio=0.05):
    """Tolerance of a method: largest error of the position over the stroke in a cycle from rest, rates asked for.

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
            run = simulate_elastic(
                CARRIED, drive, cycle, lambda v, a: np.zeros_like(v), regime="rest", tolerance=tolerance
            )
            return run.trajectory.kinematics(*run.trajectory.locate(time)).position, run.cost.evaluations
        got = solve_ivp(rates, (0, 2 * PASS), [0.0, 0.0], method, time, rtol=tolerance, atol=tolerance * STRETCH)
        return got.y[0], got.nfev

    for method, tolerance in settings:
        (position, work), seconds = timed(lambda m=method, t=tolerance: solved(m, t), repeats)
        yield method, tolerance, np.abs(position - exact).max() / STRETCH, seconds, work


def harmonic_response(time, natural, ratio, omega):
    """x(t) from rest: H = (w^2 + 2 i z w W)/(w^2 - W^2 + 2 i z w W) for the driven end, plus the free vibration."""
    pull = natural**2 + 2j * ratio * natural * omega
    H = pull / (pull - omega**2)
    fading, ringing = ratio * natural, natural * np.sqrt(1 - ratio**2)
    A = STRETCH / 2 * (H.real - 1)
    B = (STRETCH / 2 * (1j * omega * H).real + fading * A) / ringing
    steady = STRETCH / 2 * (1 - (H * np.exp(1j * omega * time)).real)
    return steady + np.exp(-fading * time) * (A * np.cos(ringing * time) + B * np.sin(ringing * time))


def maps(settings, _):
    """Tolerance of a map by the spectral engine: largest error over the largest force, contacts."""

    def force(speed):
        rolled = spectral.roll(LAYER, PRESSED, MIX, speed)
        return rolled.resistance, rolled.error[1]

    speeds = np.geomspace(0.002, 1.0, 60)
    exact = np.array([force(speed)[0] for speed in speeds])
    for method, tolerance in settings:
        found, seconds = timed(lambda t=tolerance: sample_resistance(force, 0.02, 1.0, t), 1)
        yield method, tolerance, np.abs(found(speeds) - exact).max() / exact.max(), seconds, len(found.speeds)


def columns(settings, repeats):
    """Tolerance of a step: error of the resistance of a pass, evaluations."""
    roller = Roller(0.11, indentation=0.002, profile="circle")
    exact = column.roll(THIN, roller, PRESSABLE, 0.2, rtol=1e-13).resistance
    for method, rtol in settings:
        found, seconds = timed(lambda r=rtol: column.roll(THIN, roller, PRESSABLE, 0.2, rtol=r), repeats)
        yield method, rtol, abs(found.resistance / exact - 1), seconds, found.evaluations


def compactions(settings, _):
    """Increments per contact length: error of the resistance against FINEST of them, steps."""
    from compact.engines.compaction import engine as compaction

    def rolled(increments):
        roller = Roller(0.11, indentation=0.002, profile="deformed")
        return compaction.roll(THIN, roller, PRESSABLE, 0.2, increments=increments)

    exact = rolled(FINEST).resistance
    for method, increments in settings:
        start = perf_counter()
        found = rolled(increments)
        seconds = perf_counter() - start
        yield method, increments, abs(found.resistance / exact - 1), seconds, len(found.steps)


@dataclass(frozen=True)
class Question:
    """One figure.

    rows : generator of (method, setting, error, seconds, work) for settings, the least seconds of several repeats
    settings : of the full figure;  defaults : those of the package; 0.01 is the tolerance of the scenes
    error : quantity of the error
    """

    rows: Callable
    settings: tuple
    defaults: tuple
    error: str


def ladder(method, *values):
    """Settings of one method."""
    return tuple((method, value) for value in values)


QUESTIONS = {
    "layers": Question(
        layers,
        ladder("spectral", 1e-2, 1e-3, 1e-4, 1e-5, 1e-6) + ladder("fem", 1e-2, 5e-3, 2e-3, 5e-4),
        (("spectral", 1e-2), ("fem", 1e-2)),
        "resistance, worst of ten speeds",
    ),
    "drives": Question(
        drives,
        sum((ladder(name, 1e-4, 1e-6, 1e-8, 1e-10) for name in ("ours", "RK45", "DOP853", "Radau", "LSODA")), ()),
        (("ours", 1e-8),),
        "position over the stroke",
    ),
    "maps": Question(maps, ladder("map", 1e-1, 3e-2, 1e-2, 3e-3, 1e-3), (("map", 1e-2),), "force over its largest"),
    "columns": Question(columns, ladder("column", 1e-3, 1e-5, 1e-7, 1e-9, 1e-11), (("column", 1e-9),), "resistance"),
    "compaction": Question(
        compactions, ladder("compaction", 6, 12), (("compaction", 12),), f"resistance, against {FINEST} increments"
    ),
}
QUICK = ("layers", "drives", "maps", "columns")


def main(questions=QUICK, repeats=3, out=None, **settings):
    """Rows by question; `out` is a folder for a table and the figures, `settings` replace those of a question."""
    answers = {
        name: [tuple(row) for row in QUESTIONS[name].rows(settings.get(name, QUESTIONS[name].settings), repeats)]
        for name in tracked(questions, str, alike=False)
    }
    if out:
        from compact.files import write_csv

        rows = [(name, *row) for name, answer in answers.items() for row in answer]
        write_csv(Path(out) / "speed_against_error.csv", HEADER, rows)
        for name, answer in answers.items():
            draw(QUESTIONS[name], answer).savefig(Path(out) / f"{name}.png", dpi=110)
    return answers


def draw(question, rows):
    """Draw seconds over the error, one line for each method, the default marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.6, 4.0), layout="constrained")
    ax = figure.subplots()
    for method in dict.fromkeys(row[0] for row in rows):
        settings, errors, seconds = np.array([row[1:4] for row in rows if row[0] == method]).T
        line = ax.loglog(np.maximum(errors, 1e-16), seconds, "o-", markersize=4, label=method)[0]
        for setting, error, second in zip(settings, np.maximum(errors, 1e-16), seconds, strict=True):
            ax.annotate(f"{setting:g}", (error, second), fontsize=7, xytext=(3, 3), textcoords="offset points")
            if (method, setting) in question.defaults:
                ax.plot(error, second, "o", markersize=13, fillstyle="none", color=line.get_color())
    low, high = ax.get_ylim()
    ax.set_ylim(low / 2, 2 * high)  # so that what costs the same looks it
    ax.set(xlabel=f"true relative error: {question.error}", ylabel="seconds, this machine")
    ax.legend(frameon=False, fontsize=8, title="labels: setting; ringed: default", title_fontsize=8)
    return figure


def show(answers):
    """Print the rows of `main`, the defaults marked."""
    for name, rows in answers.items():
        print(f"{name}: error of {QUESTIONS[name].error}")
        for method, setting, error, seconds, work in rows:
            mark = "  default" if (method, setting) in QUESTIONS[name].defaults else ""
            print(f"    {method:<11}{setting:<8g}{error:9.1e}{seconds * 1e3:12.2f} ms{work:9d}{mark}")


if __name__ == "__main__":
    show(main(sys.argv[1:] or QUICK, out="out/speed_against_error"))
