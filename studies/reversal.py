"""Is the resistance after a turn the steady one times a share of the travel?

A free roller in steady motion turns. Behind it fresh mix lies from an edge on, D behind the axle, so that it returns on
its own track and then presses the layer of the stroke before. The shares of steady force and load over the travel, by
finite elements that move with the mix, are compared with `compact.turning`, whose constants are refitted to half of the
cases. x = (s - d)/a are contact lengths beyond the place d at which fresh mix is met. A second table has the peaks of
six laws behind two springs, by the formulas and by a step, against those by the history itself as a table over the
travel. Limits: one mix, friction 0.35.
"""

import math
from dataclasses import dataclass, replace
from functools import cache, partial
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
from scipy.optimize import least_squares

from compact import turning
from compact.engines.compaction.engine import roll
from compact.engines.compaction.reciprocating import simulate_reciprocating
from compact.machine.cart import Cart
from compact.machine.elastic_drive import ElasticDrive, simulate_elastic
from compact.material.laws import Compaction
from compact.motion.profile import law
from compact.resistance import dry_resistance
from compact.rolling_contact import Layer, Roller

FRICTION, SPEED, STEADY = 0.35, 0.133, 2.0  # [-], [m/s], [-] contact lengths before the turn
ANGLE, COHESION = np.radians(35), 10e3  # of the mix [rad], [Pa]
MIX = Compaction(
    unloading_modulus=120e6, poisson=0.3, heckel_slope=16.45e-6 / 1.0208, loose_density_ratio=0.72,
    fed_density_ratio=0.93576, critical_slope=float(np.sqrt(3) * np.sin(ANGLE)),
    tensile_strength=float(COHESION / np.tan(ANGLE)), heckel_test="isotropic",
)  # fmt: skip
RELEASED, SPACING = 0.1, 0.1  # [-], contact lengths that are not compared after the turn, and between compared places
SHOWN = (-0.5, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # [-], x of the printed shares
CONSTANTS = (
    "CLIMB", "WAVE_LENGTH", "WAVE_EXPONENT", "TRACK", "LOAD_WAVE_LENGTH", "LOAD_TRACK",
    "FILM", "FILM_CLIMB", "FILM_POWER", "FILM_LOAD_POWER",
)  # fmt: skip
LAWS = "parabolic", "cubic", "quintic", "harmonic", "cycloidal", "reversal-2"
STROKE, DURATION, FORCE = 0.4, 0.889, 3566.0  # [m], [s], [N]
CART = Cart(
    mass=1000.0, weight=9810.0, roller_positions=(0.0,), roller_reactions=(9740.0,), guide_positions=(0.4, -0.4),
    pin_position=0.6, pin_height=0.1, roller_radius=0.11, guide_wheel_diameter=0.1, guide_friction=0.0,
)  # fmt: skip
SPRINGS, DAMPING_RATIO, JOIN = (1e6, 3e6), 0.05, 0.08  # [N/m], [-]; contact lengths from which the history is a table


@dataclass(frozen=True)
class Case:
    """Heights and depth [m], contact lengths in fresh mix, make-up (thickness [m], density ratio, depth before [m])."""

    height: float
    depth: float
    extent: float
    fitted: bool
    radius: float = 0.11
    make_up: tuple[float, float, float] | None = None


CASES = {
    "published": Case(0.06284, 0.0030, 10.0, fitted=True),
    "deeper": Case(0.06284, 0.0033, 10.0, fitted=False),
    "shallow": Case(0.06284, 0.0015, 6.0, fitted=False),
    "thin layer": Case(0.02, 0.0005, 4.0, fitted=True),
    "make-up": Case(0.06284, 0.0008, 6.0, fitted=True, make_up=(0.001, 0.75, 0.002)),
    "of 4 mm": Case(0.06284, 0.0024, 6.0, fitted=True, make_up=(0.004, 0.75, 0.002)),
    "of 2 mm": Case(0.06284, 0.0016, 6.0, fitted=False, make_up=(0.002, 0.75, 0.002)),
    "denser": Case(0.06284, 0.0006, 6.0, fitted=False, make_up=(0.001, 0.85, 0.002)),
    "wide": Case(0.045, 0.0020, 5.0, fitted=True, radius=0.2),
}
EDGES = 2.0, 13 / 3  # [-], D over the contact length


@cache
def steady(name, increments):
    """Return material, fed layer and steady contact of a case."""
    case, mix, fed = CASES[name], MIX, None
    roller = Roller(case.radius, indentation=case.depth, friction=FRICTION, rolling="free", profile="deformed")
    layer = Layer(case.height)
    if case.make_up:
        thickness, ratio, depth = case.make_up
        before = roll(layer, replace(roller, indentation=depth), MIX, SPEED, increments=6)
        mix = replace(MIX, fed_density_ratio=ratio)
        fed = before.exit.with_lift(thickness, mix)
        layer = Layer(fed.height)
    return mix, fed, roll(layer, roller, mix, SPEED, fed_layer=fed, increments=increments)


def run(name, places, edge, increments):
    """Return strokes between places, from steady motion on: x over the contact length, shares of force and load."""
    mix, fed, start = steady(name, increments)
    length = float(np.sqrt(2 * start.roller.radius * start.roller.indentation))
    positions = length * np.asarray(places)
    times = np.append(0.0, np.cumsum(np.abs(np.diff(positions))))
    position = partial(np.interp, xp=times, fp=positions)
    motion = SimpleNamespace(
        duration=times[-1], position=position, velocity=lambda time: np.gradient(position(time), time)
    )
    motion.discontinuities = lambda: [SimpleNamespace(time=time) for time in times[1:-1]]
    options = {"fed_layer": fed, "start": start, "increments": increments, "estimate": False}
    done = simulate_reciprocating(start.layer, start.roller, mix, motion, edge_distance=edge * length, **options)
    before = (done.stroke == 1) & (done.position > (places[1] - 1) * length)
    force, load = (forces / forces[before].mean() for forces in (done.resistance, done.load))
    wave, modulus = start.bow_wave / start.roller.indentation, MIX.unloading_modulus / (1 - MIX.poisson**2)
    release = turning.elastic_release(
        start.roller.radius, modulus, start.layer.height, start.leading, start.peak_pressure
    )
    return SimpleNamespace(
        x=done.position / length, stroke=done.stroke, force=force, load=load, wave=wave, release=release / length,
        front=start.leading / start.layer.height,
    )  # fmt: skip


def history(name, edge, increments=6):
    """Return x, shares of force and load after a turn, wave over depth, and D, make-up and release told over a."""
    done = run(name, (0, STEADY, STEADY - (edge - 1) - CASES[name].extent), edge, increments)
    back = (done.stroke == 2) & (done.x < STEADY)
    x = STEADY - done.x[back] - (edge - 1)
    case = CASES[name]
    thickness = case.make_up[0] / math.sqrt(2 * case.radius * case.depth) if case.make_up else None
    force, load = -done.force[back], done.load[back]
    return SimpleNamespace(
        x=x, force=force, load=load, wave=done.wave, edge=edge, release=done.release, front=done.front,
        thickness=thickness,
    )  # fmt: skip


def shares(found, values):
    """Return the shares of force and load by the formulas of `turning` with values of `CONSTANTS`."""
    contact = 1.0, 1.0, found.wave, found.release, found.edge, found.thickness
    with patch.multiple(turning, **dict(zip(CONSTANTS, values, strict=True))):
        return [share(found.x + found.edge - 1) for share in turning.wave_shares(*contact)]


def residuals(found, values):
    """Return the differences of the shares of force and load after the release, at places of equal distance."""
    places = np.arange(found.x[0] + RELEASED, found.x[-1], SPACING)
    pairs = zip((found.force, found.load), shares(found, values), strict=True)
    return [np.interp(places, found.x, shown - computed) for shown, computed in pairs]


def fit(histories):
    """Return the values of the constants of the least squares of the differences over some histories."""
    found = least_squares(lambda values: np.hstack([np.hstack(residuals(each, values)) for each in histories]), told())
    return found.x.tolist()


def told():
    """Return the values of the program."""
    return [getattr(turning, name) for name in CONSTANTS]


def drive_peaks(name, found):
    """Return peak forces [N] and powers [W] by the formulas, a step and the history; of a spring and a law each."""
    depth, length = CASES[name].depth, math.sqrt(2 * CASES[name].radius * CASES[name].depth)
    lengths = found.release * length, found.edge * length, found.thickness and found.thickness * length
    formula = turning.wave_shares(length, depth, found.wave * depth, *lengths)
    travel = (found.x + found.edge - 1) * length
    middle, tables = (travel[1:] + travel[:-1]) / 2, []  # of neighbouring steps, between which the mesh alternates
    inside = middle > JOIN * length
    for values, share in zip((found.force, found.load), formula, strict=True):
        means = ((values[1:] + values[:-1]) / 2)[inside].clip(0, 1)
        later = np.linspace(middle[-1], STROKE + 0.1, 40)[1:]
        rest = 1 - (1 - share(later)) * (1 - means[-1]) / (1 - share(middle[-1]))  # beyond the run
        places, shown = np.concatenate([[0.0], middle[inside], later]), np.concatenate([means[:1], means, rest])
        told = {"track": share.track, "distance": share.distance, "release": release(found) * length}
        tables.append(turning.table_share(places, shown, **told))
    step = dry_resistance(FORCE)
    along = [turning.StrokeResistance(step, force, force, load, load) for force, load in (formula, tables)]
    return np.array([peaks(resistance) for resistance in (along[0], step, along[1])])


def peaks(resistance):
    """Return peak forces [N] and powers [W] of a cart of one tonne on free wheels behind the springs, by the laws."""
    drives = [ElasticDrive(each, 2 * DAMPING_RATIO * math.sqrt(each * CART.mass)) for each in SPRINGS]
    laws = [law(name, STROKE, DURATION) for name in LAWS]
    runs = [simulate_elastic(CART, drive, motion, resistance) for drive in drives for motion in laws]
    return [each.peak_force for each in runs], [each.peak_power for each in runs]


def release(found):
    """Return the release of the force over the contact length [-], from the first step after the turn."""
    return -(found.x[0] + found.edge - 1) / np.log((turning.TRACK - found.force[0]) / (1 + turning.TRACK))


def release_factors(histories):
    """Return the factors of half-plane and layer in the release, of the least squares over some histories."""
    known = turning.RELEASE_HALF_PLANE, turning.RELEASE_LAYER
    rows = np.array([(1.0, each.front) for each in histories])
    ratios = np.array([each.release / release(each) for each in histories])
    return np.linalg.lstsq(rows, rows @ known * ratios)[0]


def main(names=tuple(CASES), edges=EDGES, increments=6):
    """Return histories by case and edge, the constants that fit those of the fitted cases, and peaks behind springs."""
    histories = {(name, edge): history(name, edge, increments) for name in names for edge in edges}
    fitted = [found for (name, _), found in histories.items() if CASES[name].fitted]
    drives = {case: drive_peaks(case[0], found) for case, found in histories.items()}
    return {"histories": histories, "values": fit(fitted) if fitted else told(), "drives": drives}


def show(histories, values, drives):
    """Print shares of the force as found/by formula, rms and largest differences of those of force/load, and peaks."""
    print(
        f"{'case':<13}D/a   w/depth" + "".join(f"{f'x {x:g}':>11}" for x in SHOWN),
        "rms  largest  refitted  r/a found/by formula",
        sep="  ",
    )
    for (name, edge), each in histories.items():
        formula = shares(each, told())[0]
        differences, refitted = (np.array(residuals(each, constants)) for constants in (told(), values))
        rms, others = (np.sqrt(np.mean(found**2, axis=1)) for found in (differences, refitted))
        line = [f"{_words(name)}{edge:.2f}{each.wave:8.2f}"]
        line += [f"{np.interp(x, each.x, each.force):6.2f}/{np.interp(x, each.x, formula):.2f}" for x in SHOWN]
        ends = rms, np.abs(differences).max(axis=1), others
        lengths = f"{release(each):.4f}/{each.release:.4f}"
        print("".join(line), *("{:.3f}/{:.3f}".format(*end) for end in ends), lengths, sep=" ")
    print("* held out; refitted to the others:", *(f"{n} {v:.3g}" for n, v in zip(CONSTANTS, values, strict=True)))
    fitted = [each for (name, _), each in histories.items() if CASES[name].fitted]
    if fitted:
        print("release: half-plane {:.2f}, layer {:.2f}".format(*release_factors(fitted)))
    print(f"\n{'peaks behind springs, %':<27}{'force':>10}{'power':>16}{'with a step':>18}")
    for (name, edge), (formula, step, found) in drives.items():
        errors = 100 * (np.array([formula, step]) / found - 1)
        (force, power), (stepped, _) = errors
        ranges = [f"{each.min():+.1f} to {each.max():+.1f}" for each in (force, power, stepped)]
        print(f"{_words(name)}{edge:.2f}{ranges[0]:>20}{ranges[1]:>16}{ranges[2]:>18}")


def _words(name):
    """Name of a case with a star where it is held out."""
    return f"{name + ' *'[2 * CASES[name].fitted :]:<13}"


if __name__ == "__main__":
    show(**main())
