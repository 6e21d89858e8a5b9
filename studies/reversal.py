"""Error of the steady-speed resistance map near a reversal, against the transient engine.

A frictionless roller moves forward and back over the linear layer of the scene. The transient solution by finite
elements is the reference. Two models are compared with it: the map of steady speeds, F_ss(v), and the same with the
added mass, F_ss + a M, which is valid only where |a| tau/|v| is small. Errors are relative to the largest force of the
transient solution; costs are processor seconds to build the model and to evaluate one cycle.

Behind a compliant drive, a spring or a motor, the motion of the cart depends on the model of the resistance. The
transient solution is computed for that motion; errors are those of the force in the return stroke and its reversals.
"""

from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from compact import fem
from compact.analysis.contact_cases import contact_inputs
from compact.analysis.engines import expand_resistance
from compact.analysis.stages.laws import OVERSHOOT
from compact.analysis.study import Study
from compact.drive import simulate
from compact.engines.spectral import engine as spectral
from compact.machine.elastic_drive import ElasticDrive
from compact.machine.motor_characteristics import LinearTorqueCurve
from compact.machine.motor_drive import Motor
from compact.motion.profile import law
from compact.report.progress import spinning, tracked
from compact.resistance import sample_resistance
from compact.rolling_contact import Roller
from compact.scene.loader import load_scene

SCENES = Path(__file__).parent / "scenes"
PLAIN = {
    "machine.roller_condition": "frictionless",
    "machine.gap_geometry": "parabola",
    "mix.overrides.steel_friction": 0.0,
}
HEADER = ("law", "model", "largest_error", "rms_error", "build_s", "cycle_s")
DRIVEN = ("drive", "model", "peak_force_N", "energy_J", "largest_error", "rms_error", "run_s")
SLOWEST = 0.01  # [-], lowest over highest speed of the map
STIFFNESS, RATIO = 1e6, 0.05  # of the spring [N/m], and its damping ratio
MOTOR = Motor(
    LinearTorqueCurve(16.0, 160.0), 100.0, 0.02, 0.0
)  # assumed: the published cycle time, with reserve of power


def pressed(scene):
    """Return layer, roller at the indentation of the target of the scene at its mean speed, and material."""
    speed = scene.motion.stroke / scene.motion.duration
    layer, roller, material = contact_inputs(scene, Study(scene).mix, "spectral", speed)
    indentation = spectral.roll(layer, roller, material, speed).indentation
    return layer, Roller(roller.radius, indentation=indentation), material


def timed(work):
    """Return the result of `work` and its processor seconds."""
    start = process_time()
    found = work()
    return found, process_time() - start


def models(contact, fastest, samples):
    """Build the models: F(motion, time) with its seconds by name, the map of steady speeds, the map with added mass."""

    def resistance(speed):
        rolled = spectral.roll(*contact, speed)
        return rolled.resistance, max(rolled.error)

    steady, mapping = timed(lambda: sample_resistance(resistance, SLOWEST * fastest, fastest, 2e-3))
    speeds = np.geomspace(SLOWEST * fastest, fastest, samples)
    masses, added = timed(lambda: np.array([expand_resistance(*contact, speed).added_mass for speed in speeds]))

    def with_added_mass(velocity, acceleration):
        mass = np.interp(np.log(np.maximum(np.abs(velocity), speeds[0])), np.log(speeds), masses)
        return steady(velocity) + acceleration * mass

    evaluations = {
        "map": (lambda motion, time: steady(motion.velocity(time)), mapping),
        "map + a M": (
            lambda motion, time: with_added_mass(motion.velocity(time), motion.acceleration(time)),
            mapping + added,
        ),
    }
    time = max(time for _, time in contact[2].branches)
    accelerated = replace(
        steady, added_masses=np.interp(np.log(steady.speeds), np.log(speeds), masses), relaxation_time=time
    )
    return evaluations, steady, accelerated


class SimulatedMotion:
    """Motion of the cart in a simulated run."""

    def __init__(self, run):
        time, first = np.unique(run.time, return_index=True)
        self.position = CubicHermiteSpline(time, run.state.position[first], run.state.velocity[first])
        self.velocity, self.duration = self.position.derivative(), float(time[-1])


def driven(study, contact, cycle, steady, accelerated):
    """Return rows of DRIVEN of one law: each drive with each model of the resistance."""
    share = study.scene.machine.rollers * study.scene.machine.roller_length
    damping = 2 * RATIO * np.sqrt(STIFFNESS * study.cart.mass)
    rows = []
    for kind in ("elastic", "motor"):
        for model, force in (("map", steady), ("map + a M", accelerated)):
            drive = (
                ElasticDrive(STIFFNESS, damping, include_added_mass=force is accelerated)
                if kind == "elastic"
                else MOTOR
            )
            run, seconds = timed(
                lambda drive=drive, force=force: simulate(study.cart, drive, cycle, force.scaled(share))
            )
            exact = fem.travel(*contact, SimulatedMotion(run), estimate=False)
            back = exact.time > exact.time[-1] / 2
            error = share * exact.resistance - np.interp(exact.time, run.time, run.state.resistance)
            error = error[back] / (share * np.abs(exact.resistance).max())
            mean_square = np.trapezoid(error**2, exact.time[back]) / np.ptp(exact.time[back])
            rows.append((
                kind, model, run.peak_force, run.energy, float(np.abs(error).max()), float(np.sqrt(mean_square)),
                seconds,
            ))  # fmt: skip
    return rows


def main(scene="loveikin-2015", laws=("parabolic", "quintic", "septic", "reversal-4"), samples=9, out=None, **changes):
    """Return rows of HEADER, and rows of DRIVEN of the first law; the transient has its own error estimate."""
    scene = load_scene(SCENES / f"{scene}.toml", **PLAIN | changes)
    contact = pressed(scene)
    motions = {name: law(name, scene.motion.stroke, scene.motion.duration) for name in laws}
    fastest = max(motion.peaks().velocity for motion in motions.values())
    with spinning("models"):
        evaluations, steady, accelerated = models(contact, OVERSHOOT * fastest, samples)
    rows, histories = [], {}
    for name, motion in tracked(motions.items(), "law"):
        cycle = motion.cycle()
        exact, seconds = timed(lambda cycle=cycle: fem.travel(*contact, cycle))
        peak = np.abs(exact.resistance).max()
        rows.append((name, "transient", exact.error, exact.error, 0.0, seconds))
        histories[name] = [("transient", exact.time, exact.resistance)]
        for model, (force, build) in evaluations.items():
            found, seconds = timed(lambda force=force, cycle=cycle, exact=exact: force(cycle, exact.time))
            error = (found - exact.resistance) / peak
            mean_square = np.trapezoid(error**2, exact.time) / cycle.duration
            rows.append((name, model, float(np.abs(error).max()), float(np.sqrt(mean_square)), build, seconds))
            histories[name].append((model, exact.time, found))
    with spinning("compliant drives"):
        behind = driven(Study(scene), contact, next(iter(motions.values())).cycle(), steady, accelerated)
    if out:
        from compact.files import write_csv, write_figure

        write_csv(Path(out) / "reversal.csv", HEADER, rows)
        write_csv(Path(out) / "reversal_driven.csv", DRIVEN, behind)
        write_figure(Path(out) / "reversal.png", figure(rows, histories))
    return rows, behind


def figure(rows, histories):
    """Draw the force over time of the first law, and the error of all laws over the time of evaluation."""
    from matplotlib.figure import Figure

    from compact.report.figures.style import PALETTE

    drawn = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = drawn.subplots(1, 2)
    first = next(iter(histories))
    peak = np.abs(histories[first][0][2]).max()
    for k, (model, time, force) in enumerate(histories[first]):
        colour = PALETTE[k - 1] if k else "black"
        left.plot(time, force, "-", color=colour, label=model, linewidth=1.2 + k / 2)
        chosen = [row for row in rows if row[1] == model]
        right.loglog([row[5] for row in chosen], [row[2] for row in chosen], "o", color=colour)
    left.set_ylim(-1.3 * peak, 1.3 * peak)
    left.set_xlabel("time t [s]")
    left.set_ylabel("resistance F [N/m]")
    left.legend(frameon=False, title=first, fontsize="small")
    right.set_xlabel("time to evaluate a cycle [s]")
    right.set_ylabel("largest error over the peak force [-]")
    return drawn


def show(result):
    """Print the rows of `main`."""
    rows, behind = result
    print(f"{'law':<14}{'model':<14}{'largest':>9}{'rms':>9}{'build s':>10}{'cycle s':>10}")
    for name, model, largest, rms, build, seconds in rows:
        print(f"{name:<14}{model:<14}{100 * largest:>8.2f}%{100 * rms:>8.2f}%{build:>10.2f}{seconds:>10.4f}")
    print(f"{'drive':<14}{'model':<14}{'largest':>9}{'rms':>9}{'peak N':>10}{'run s':>10}")
    for drive, model, peak, _, largest, rms, seconds in behind:
        print(f"{drive:<14}{model:<14}{100 * largest:>8.2f}%{100 * rms:>8.2f}%{peak:>10.1f}{seconds:>10.4f}")


if __name__ == "__main__":
    show(main(out="out/reversal"))
