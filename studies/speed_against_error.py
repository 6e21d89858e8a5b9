"""How fast is each method, against a plain baseline timed in the same run?

Ratios count, seconds belong to the machine. Formulas: points per second over arrays in which every argument varies.
Layers: error against tolerance and time of the spectral and the finite-element engine (goals 30 and 300 ms a speed).
Laws: position to snap at many instants against one numpy.polyval of the law's degree per derivative. Peaks: error of
sampling a law at n instants against the roots that `peaks` solves for. Command: whole processes.
"""

import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from compact import contact, fem, spectral
from compact.material import Viscoelastic
from compact.motion import law
from compact.records import Layer, Roller

SCENE = Path(__file__).parent / "scenes" / "loveikin-2015.toml"
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

    The layer of the published machine, E(t) = 10 + 10 exp(-t/0.1 s) MPa, 3 mm deep; the judge is the spectral engine
    at a tolerance of 1e-8. Finite elements pay for a mesh once, which the first of the repeats does.
    """
    layer, roller = Layer(0.22), Roller(0.11, indentation=0.003)
    mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    velocities = np.geomspace(0.003, 3, 10)

    def resistances(engine, **numerics):
        return np.array([engine.roll(layer, roller, mix, v, **numerics).resistance for v in velocities])

    exact = resistances(spectral, rtol=1e-8)
    rows = []
    for name, tolerance in settings:
        engine, keyword = {"spectral": (spectral, "rtol"), "fem": (fem, "tolerance")}[name]
        found = resistances(engine, **{keyword: tolerance})
        seconds = fastest(lambda e=engine, k=keyword, t=tolerance: resistances(e, **{k: t}), repeats) / len(velocities)
        rows.append((name, tolerance, float(np.abs(found / exact - 1).max()), seconds))
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


SETTINGS = tuple(("spectral", 10.0**-n) for n in (3, 4, 5, 6)) + tuple(("fem", error) for error in (1e-2, 3e-3, 1e-3))


def main(points=1_000_000, repeats=5, samples=(100, 1000, 10_000, 100_000), settings=SETTINGS, out=None):
    """All figures; `out` names a directory for speed.csv."""
    seconds, memory = commands(max(1, repeats // 3))
    result = {
        "formulas": formulas(points, repeats),
        "laws": laws(points, repeats),
        "peaks": peaks(samples, repeats),
        "layers": layer_engines(settings, max(1, repeats // 2)),
        "commands": seconds,
        "memory": memory,
    }
    if out:
        from compact.results import write_csv

        rows = [(f"eq {name}", rate, "points/s") for name, rate in result["formulas"].items()]
        rows += [(f"law {name}", ratio, "of numpy.polyval") for name, ratio in result["laws"].items()]
        rows += [(name, value, "s") for name, value in seconds.items()]
        write_csv(Path(out) / "speed.csv", ("what", "value", "unit"), rows)
    return result


def show(result):
    """Print the figures of `main`."""
    for name, rate in result["formulas"].items():
        print(f"eq {name:<5}{rate / 1e6:10.1f} million points/s   (goal 10)")
    for name, ratio in result["laws"].items():
        print(f"{name:<12} five derivatives {ratio:5.2f} x numpy.polyval   (goal 5)")
    for count, error, ratio in result["peaks"]:
        print(f"peak by {count:>6} samples: error {error:.1e}, {ratio:7.3f} x the time of the exact roots")
    for engine, tolerance, error, seconds in result["layers"]:
        print(f"{engine:<9} asked {tolerance:.0e}: error {error:.1e}, {seconds * 1e3:6.1f} ms a speed")
    for name, value in result["commands"].items():
        print(f"{name:<16}{value:7.3f} s")
    print(f"peak memory     {result['memory']:7.0f} MB   (goal 300)")


if __name__ == "__main__":
    show(main())
