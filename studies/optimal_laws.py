"""Gain of optimal motion laws, and the cost of each requirement on a law.

For the published machine, laws of least peak force and of least peak power are computed with constant speed over two
thirds of the pass and a bound on the acceleration. Each is compared with the best published law within the same bounds,
at the nominal resistance and at both ends of the spread of the mix. Two Pareto fronts follow: least peak power over the
share of constant speed, and least peak force over the jerk. Limits: equations 1.1-1.10, a resistance independent of
speed and a step at the turn, since the optimisation has the force far from a turn; a rigid drive. Without the bound on
the acceleration the least peak power is 479 W, but the law decelerates with 300 m/s2 at the end.
"""

from pathlib import Path

import numpy as np

from compact.analysis.study import Study
from compact.drive import Rigid, simulate
from compact.motion.limits import Limits, violations
from compact.motion.optimal_motion import optimise
from compact.motion.profile import law
from compact.report.progress import tracked
from compact.scene.loader import LAW_NAMES, load_scene

SCENES = Path(__file__).parents[1] / "compact" / "data" / "scenes"
OBJECTIVES = ("peak_force", "peak_power")
ACCELERATION = 0.6  # [m/s2]; assumed, above the acceleration of all published reversal laws
SHARES = (0.0, 0.2, 0.4, 0.5, 0.6, 2 / 3, 0.75, 0.8)
JERKS = (2.5, 3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 20.0)
GAINS = ("objective", "resistance_N", "best_published", "published", "least", "gain", "robust", "robust_gain")
FRONT = ("front", "bound", "least", "best_published", "published", "gap")


def main(scene="loveikin-2015", shares=SHARES, jerks=JERKS, out=None):
    """Return rows of GAINS, at the nominal resistance and at both ends of its spread, and rows of FRONT; SI.

    `least` is the value of the law that is optimal for the nominal resistance, `robust` that of the law of least regret
    over the spread.
    """
    scene = load_scene(SCENES / f"{scene}.toml", **{"output.items": [], "drive.turn": "step"})  # what is optimised
    table = {"objectives": list(OBJECTIVES), "smoothness": 1, "acceleration": ACCELERATION, "steady_tolerance": 0.0}
    nominal = Study(scene.replaced(**{"motion.optimise": table}))
    robust = Study(scene.replaced(**{"motion.optimise": table | {"spread": ["required_pressure"]}}))
    gains = [row for objective in tracked(OBJECTIVES, str) for row in _gains(objective, nominal, robust)]
    front = [
        ("share", share, *_front_point(nominal, "peak_power", (1 - share) / 2))
        for share in tracked(shares, "share of constant speed")
    ]
    front += [
        ("jerk", jerk, *_front_point(nominal, "peak_force", scene.motion.run_up, jerk))
        for jerk in tracked(jerks, "bound of the jerk")
    ]
    if out:
        from compact.files import write_csv

        write_csv(Path(out) / "optimal_laws_gains.csv", GAINS, gains)
        write_csv(Path(out) / "optimal_laws_fronts.csv", FRONT, front)
        _draw(nominal, front).savefig(Path(out) / "optimal_laws.png", dpi=110)
    return gains, front


def _gains(objective, nominal, robust):
    """Yield rows of GAINS for one objective."""
    name = f"least-{objective.replace('_', '-')}"
    published = [
        cycle.forward
        for cycle in nominal.stages.laws.prescribed.values()
        if not violations(nominal.stages.laws.limits, cycle.forward)
    ]
    for load in robust.stages.laws.motion_resistances:
        optimal, regret = (
            _value(objective, load, study.stages.laws.cycles[name].forward) for study in (nominal, robust)
        )
        best, least = _best(objective, load, published)
        yield objective, load.resistance.force, best, least, optimal, 1 - optimal / least, regret, 1 - regret / least


def _value(objective, load, motion):
    """Simulate a law with a rigid drive; return the value of the objective."""
    return getattr(simulate(load.cart, Rigid(), motion, load.resistance), objective)


def _best(objective, load, laws):
    """Return name and value of the law of the least value; "" and nan without laws."""
    values = {each.name: _value(objective, load, each) for each in laws}
    best = min(values, key=values.get, default="")
    return best, values.get(best, np.nan)


def _front_point(study, objective, run, jerk=None):
    """Return the least value for run-up and run-down shares, best published law within the limits, its value, gap."""
    motion = study.scene.motion
    limits = Limits(acceleration=ACCELERATION, run_up=run, run_down=run, jerk=jerk)
    optimal = optimise(
        objective,
        motion.stroke,
        motion.duration,
        study.stages.resistance.cart.mass,
        study.stages.resistance.motion_resistance,
        limits,
    )
    laws = [law(name, motion.stroke, motion.duration, run, run, rod_length=motion.rod_length) for name in LAW_NAMES]
    return (
        optimal.value,
        *_best(
            objective, study.stages.resistance.motion_resistance, [one for one in laws if not violations(limits, one)]
        ),
        optimal.gap,
    )


def _draw(study, front):
    """Draw velocity and drive power of the optimal laws and of two published ones, and both Pareto fronts."""
    from matplotlib.figure import Figure

    from compact.report.figures import PALETTE, law_style

    figure = Figure(figsize=(12.5, 7.2), layout="constrained")
    (speed, power), panels = figure.subplots(2, 2)
    time = np.linspace(0, study.scene.motion.duration, 3001)
    styles = {"least-peak-power": {"color": PALETTE[0]}, "least-peak-force": {"color": PALETTE[4]}}
    styles |= {name: law_style(name) for name in ("reversal-4-free-acceleration", "reversal-2")}
    for name, style in styles.items():
        forward = study.stages.laws.cycles[name].forward
        v, a = forward.velocity(time), forward.acceleration(time)
        speed.plot(time, v, **style, label=name)
        power.plot(
            time,
            (study.stages.resistance.cart.mass * a + study.stages.resistance.motion_resistance(np.maximum(v, 1e-9), a))
            * v,
            **style,
        )
    speed.set(xlabel="time t [s]", ylabel="velocity v [m/s]")
    power.set(xlabel="time t [s]", ylabel="drive power P [W]")
    speed.legend(frameon=False, fontsize=8, loc="lower center")
    axes = ("share of constant speed [-]", "least peak power [W]"), ("bound on the jerk [m/s³]", "least peak force [N]")
    for ax, kind, (bound, value) in zip(panels, ("share", "jerk"), axes, strict=True):
        places, least, published = np.array([(row[1], row[2], row[4]) for row in front if row[0] == kind], float).T
        ax.plot(places, least, "o-", label="optimal law")
        ax.plot(places, published, "s", markersize=4, color="0.45", label="best published law within the same bounds")
        ax.set(xlabel=bound, ylabel=value)
        ax.legend(frameon=False, fontsize=8)
    return figure


def show(result):
    """Print the results of `main`."""
    gains, front = result
    for objective, force, best, published, least, gain, robust, robust_gain in gains:
        print(f"{objective:<11}at {force:6.0f} N: {published:8.2f} {best:<29}", end="")
        print(f"{least:8.2f} optimal for {gains[0][1]:.0f} N ({gain:+.2%})", end="")
        print(f"{robust:8.2f} of least regret ({robust_gain:+.2%})")
    for kind, bound, value, best, published, gap in front:
        published_law = f"{published:8.2f} {best or 'no published law':<30}"
        print(f"{kind:<6}{bound:>8.3g}: {value:8.2f} optimal, {published_law}gap {gap:.0e}")


if __name__ == "__main__":
    show(main(out="out/optimal_laws"))
