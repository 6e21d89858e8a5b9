"""Our side of the published numbers of the machine: the engineering method (D ch. 1) and the four-cart crank (C).

Each public function returns numbers by name; `published` lays them beside the print.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from compact import contact
from compact.machine.cart import Cart, balance
from compact.machine.crankshaft import USUAL_ANGLES, crank_travel, turn
from compact.machine.rigid_drive import Crank
from compact.numerics.piecewise import integral


@dataclass(frozen=True)
class Machine:
    """A roller machine with a crank as printed; SI, names as in `Cart` and `Crank`.

    roller_reaction, interaction_force : of one roller, vertical and along the travel [N]
    moving_force : to move the cart with its rollers, guide friction included [N]
    width, height : of the product, along the travel and upright [m]; feeder_sleeve, overlap : B_T, b_n of (1.2) [m]
    """

    cart: Cart
    crank: Crank
    angular_speed: float
    roller_reaction: float
    interaction_force: float
    moving_force: float
    rollers: int
    width: float
    height: float
    feeder_sleeve: float
    overlap: float


# C, but for feeder_sleeve and overlap, which no source gives: with 3 rollers they fit (1.2), (1.3) and the stroke.
PUBLISHED_MACHINE = Machine(
    cart=Cart(
        mass=1000.0,
        weight=10e3,
        roller_positions=(0.27, -0.27),
        roller_reactions=(9740.0, 9740.0),
        guide_positions=(0.37, -0.37),
        pin_position=0.65,
        pin_height=0.1,
        roller_radius=0.11,
        guide_wheel_diameter=0.046,
        guide_friction=0.008,
    ),
    crank=Crank(radius=0.2, rod_length=0.8),
    angular_speed=10.5,
    roller_reaction=9740.0,
    interaction_force=7962.0,
    moving_force=3562.0,
    rollers=2,
    width=1.164,
    height=0.22,
    feeder_sleeve=0.18,
    overlap=0.012,
)
# Point where (1.4)-(1.10) are evaluated: our prior of the mix at moisture 0.10, density ratio 0.98, not published.
PRESSURE, MODULUS, POISSON, STEEL_FRICTION = 0.203e6, 0.75e6, 0.3, 0.35
ROLLER_LENGTH = 1.164  # assumed: no source gives it, and pressures and moduli scale as its inverse [m]
ROLLER_FRICTION = 0.12 + 0.05  # f2 + f3 of (1.8)
GUIDES = {
    "bearing_friction": 0.05,
    "journal_diameter": 0.02,
    "rolling_arm": 5e-4,
    "wheel_diameter": 0.046,
    "rib_factor": 1.5,
}
VELOCITY = 0.16  # m/s
PRINTED_MEAN_POWER, PRINTED_SUM_OVER_MEAN = 4738.8, 21872.2 / 18993.8  # C: of a cart [W]; of four carts [-]


def engineering():
    """(1.1)-(1.10), and what the published operating point says of the mix."""
    m, no_friction = PUBLISHED_MACHINE, _chain(0.0, MODULUS)
    fitted = MODULUS * no_friction["force"] / m.roller_reaction  # F of (1.6) at given q goes as 1/E
    radius = m.cart.roller_radius
    half_width = radius * math.sin(no_friction["capture_angle"])
    hertz = contact.hertz(radius=radius, youngs_modulus=MODULUS, poisson=POISSON, half_width=half_width)
    return _regression() | {
        "angle_over_hertz": hertz.peak_pressure / PRESSURE,
        "force_over_hertz": no_friction["force"] / (ROLLER_LENGTH * hertz.load),
        "plain_force": no_friction["force"],
        "plain_one_sided": no_friction["one_sided"],
        "fitted_ratio": PRESSURE**2 * (1 - POISSON**2) / fitted / 1e3,
        "fitted_modulus": fitted / 1e6,
        "fitted_angle": math.degrees(_chain(0.0, fitted)["capture_angle"]),
        **_size_of_machine(),
        **_resistance_coefficients(),
    }


def _chain(friction, modulus):
    """(1.4)-(1.7) at the regression point, by the name of the row."""
    radius = PUBLISHED_MACHINE.cart.roller_radius
    alpha = contact.pressure_exponent(POISSON, friction)
    angle = contact.capture_angle(PRESSURE, modulus, POISSON, alpha)
    mix = (angle, modulus, POISSON, alpha, radius, ROLLER_LENGTH)
    return {
        "exponent": alpha,
        "capture_angle": angle,
        "force": contact.roller_force(*mix),
        "one_sided": contact.roller_force(*mix, one_sided=True),
        "length": contact.contact_length(angle, radius, alpha),
    }


def _regression():
    m, chain = PUBLISHED_MACHINE, _chain(STEEL_FRICTION, MODULUS)
    one = contact.roller_resistance(
        chain["force"], chain["length"], m.cart.roller_radius, chain["exponent"], ROLLER_FRICTION
    )
    whole = contact.cart_resistance(chain["force"], one, m.rollers, m.cart.weight, **GUIDES)
    return chain | {"roller_resistance": one, "cart_resistance": whole, "power": contact.cart_power(whole, VELOCITY)}


def _size_of_machine():
    """(1.1)-(1.3): the roller, how many, and the stroke."""
    m = PUBLISHED_MACHINE
    radius, stroke = contact.radius_range(m.height), 2 * m.crank.radius
    rollers = contact.rollers_needed(m.width, m.cart.roller_radius, m.feeder_sleeve, m.overlap)
    return {
        "radius_low": radius.low,
        "radius_high": radius.high,
        "rollers": rollers,
        "stroke_as_needed": contact.stroke_needed(m.width, rollers, m.overlap),
        "stroke_as_printed": contact.stroke_needed(m.width, m.rollers, m.overlap),
        "overlap_as_printed": stroke - contact.stroke_needed(m.width, m.rollers, 0.0),
    }


def _resistance_coefficients():
    """Resistance of the mix over the normal force, the moving force freed of the guides' friction."""
    m = PUBLISHED_MACHINE
    guides = float(balance(m.cart, 0.0, m.moving_force, 1.0).guide_friction)
    mix = m.moving_force - guides
    return {
        "guide_friction": guides,
        "coefficient": mix / (m.rollers * m.roller_reaction),
        "coefficient_high": mix / (m.rollers * m.interaction_force),
        "half_moving_force": m.moving_force / m.rollers,
    }


@dataclass(frozen=True)
class _Shaft:
    """Carts of C on a shaft at uniform speed, met by a constant resistance [N]; crank angles psi [rad]."""

    resistance: float
    cart: Cart = PUBLISHED_MACHINE.cart
    speed: float = PUBLISHED_MACHINE.angular_speed
    crank: Crank = PUBLISHED_MACHINE.crank

    def turn(self, carts):
        """A turn of so many carts at their usual angles, as a `crank.Turn`."""
        resistance = contact.dry_resistance(self.resistance)
        return turn(self.cart, self.crank, self.speed, resistance, USUAL_ANGLES[carts])

    def forces(self, psi, direction):
        """`Balance` of one cart; direction +1 towards the crank, -1 away."""
        acceleration = self.speed**2 * crank_travel(self.crank, psi)[2]
        tangent = np.tan(self.crank.rod_angle(psi))
        return balance(self.cart, acceleration, direction * self.resistance, direction, tangent)

    def force_on_upper_rail(self, psi, direction):
        """H of C (9): each guide wheel loaded from the upper rail, even where its reaction turns negative."""
        pull, slide = (
            crank_travel(self.crank, psi)[2] * self.speed**2 * self.cart.mass,
            direction * self.cart.guide_friction,
        )
        lift = np.sum(self.cart.roller_reactions) - self.cart.weight
        needed = pull + direction * self.resistance + slide * lift
        return needed / (1 - slide * np.tan(self.crank.rod_angle(psi)))

    def power(self, psi, carts=1):
        """Power of so many carts [W], between the samples of a `Turn`."""
        ahead = np.add.outer(USUAL_ANGLES[carts], psi)
        drive_force = self.forces(ahead, _direction(ahead)).drive_force
        return np.sum(drive_force * self.speed * crank_travel(self.crank, ahead)[1], axis=0)

    def peak(self, carts=1):
        """Largest power [W]."""
        return _largest(lambda psi: self.power(psi, carts), 0.0, 2 * np.pi)

    def mean(self):
        """Mean power of one cart [W], integrated piece by piece between lift-offs of the rear guide wheel."""
        lifts = _crossings(lambda psi: self.forces(psi, -1.0).rear_reaction, np.pi, 2 * np.pi)
        return integral(self.power, [0.0, np.pi, *lifts, 2 * np.pi]) / (2 * np.pi)

    def mean_of(self, force):
        """Mean power [W] of a drive force of psi."""
        power = integral(
            lambda psi: force(psi) * self.speed * crank_travel(self.crank, psi)[1], [0.0, np.pi, 2 * np.pi]
        )
        return power / (2 * np.pi)


def _direction(psi):
    return np.where(np.mod(psi, 2 * np.pi) < np.pi, 1.0, -1.0)


def _largest(function, low, high):
    """Largest value on [low, high], by a grid that closes in on it."""
    for _ in range(4):
        grid = np.linspace(low, high, 721)
        values = function(grid)
        best = int(np.argmax(values))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    return values[best]


def _crossings(function, low, high):
    """Zeros of a continuous function between low and high."""
    grid = np.linspace(low, high, 361)
    change = np.flatnonzero(np.diff(np.sign(function(grid))))
    return [brentq(function, grid[i], grid[i + 1], xtol=1e-14) for i in change]


def _percent_above_zero(function, low, high):
    edges = np.array([low, *_crossings(function, low, high), high])
    above = function((edges[:-1] + edges[1:]) / 2) > 0
    return 100 * np.sum(np.diff(edges)[above]) / (high - low)


def crank():
    """Powers and guide reactions of C for the stated data, and for those that were evidently used."""
    m = PUBLISHED_MACHINE
    stated = _Shaft(m.rollers * m.interaction_force)
    bare = replace(m.cart, mass=0.0, guide_friction=0.0)
    used = _Shaft(m.moving_force, bare, speed=100 * 2 * np.pi / 60)
    massless = replace(stated, cart=replace(m.cart, mass=0.0))
    return {
        **_four_powers("stated", stated.peak(), stated.mean(), stated.peak(4), 4 * stated.mean()),
        **_four_powers("used", used.peak(), *_means_and_sum(used)),
        **_energy_balance(stated),
        **_inertia(stated),
        **_tension_half(massless),
        **_lift_off("stated", stated),
        **_lift_off("massless", massless),
    }


def _four_powers(case, one_peak, one_mean, sum_peak, sum_mean):
    return {
        f"{case}_one_peak": one_peak,
        f"{case}_one_mean": one_mean,
        f"{case}_sum_peak": sum_peak,
        f"{case}_sum_mean": sum_mean,
        f"{case}_one_over_quarter": one_peak / (sum_peak / 4),
        f"{case}_sum_over_mean": sum_peak / sum_mean,
        f"{case}_one_over_mean": one_peak / one_mean,
    }


def _means_and_sum(shaft):
    one, four = shaft.turn(1), shaft.turn(4)
    return one.mean(one.power), four.power.max(), four.mean(four.power)


def _energy_balance(stated):
    """Mean power of a constant resistance is its work over a turn, 4 r W, whatever the rod and the mass."""
    smooth = replace(stated, cart=replace(stated.cart, guide_friction=0.0))
    one, four = smooth.turn(1), smooth.turn(4)
    mean = one.mean(one.power)
    return {
        "quarter_mean_over_mean": four.mean(four.power) / 4 / mean,
        "mean_frictionless": mean,
        "mean_upper_rail": stated.mean_of(lambda psi: stated.force_on_upper_rail(psi, _direction(psi))),
        "mean_literal": stated.mean_of(lambda psi: stated.force_on_upper_rail(psi, 1.0)),
        "resistance_of_mean": stated.resistance * PRINTED_MEAN_POWER / mean,
    }


def _inertia(stated):
    """What the stated mass does at the outer dead centre, and the mass that the printed evenness would need."""
    dead_centre = stated.speed**2 * float(crank_travel(stated.crank, 0.0)[2])
    moving = replace(stated, resistance=PUBLISHED_MACHINE.moving_force)
    plain = replace(stated.cart, guide_friction=0.0)
    four = 4 * stated.resistance * 4 * stated.crank.radius * stated.speed / (2 * np.pi)

    def heavy(mass):
        return replace(stated, cart=replace(plain, mass=mass))

    mass = brentq(lambda mass: heavy(mass).peak(4) / four - PRINTED_SUM_OVER_MEAN, 2000.0, 3000.0, xtol=1e-10)
    return {
        "dead_centre": dead_centre,
        "inertia": stated.cart.mass * dead_centre,
        "peak_of_moving_force": moving.peak(),
        "peak_of_moving_force_plain": replace(moving, cart=plain).peak(),
        "inertia_for_ratio": mass * stated.crank.radius * stated.speed**2 / stated.resistance,
        "one_over_mean_then": heavy(mass).peak() / (four / 4),
    }


def _tension_half(shaft):
    """Extremes of N11 (front) and N12 (rear) on the way to the crank [N]."""
    found = {}
    for name in ("front", "rear"):

        def reaction(psi, sign=1, name=f"{name}_reaction"):
            return sign * getattr(shaft.forces(psi, 1.0), name)

        found[f"{name}_least"] = -_largest(lambda psi, of=reaction: of(psi, sign=-1), 0.0, np.pi)
        found[f"{name}_largest"] = _largest(reaction, 0.0, np.pi)
    return found


def _lift_off(case, shaft):
    """Where N12 > N11 on the way to the crank, where N12 < 0 on the way back, and what that does to the friction."""

    def surplus(psi):
        forces = shaft.forces(psi, 1.0)
        return forces.rear_reaction - forces.front_reaction

    def below(psi):
        return -shaft.forces(psi, -1.0).rear_reaction

    lowest = -_largest(below, np.pi, 2 * np.pi)
    return {
        f"{case}_rear_greater": _percent_above_zero(surplus, 0.0, np.pi),
        f"{case}_rear_lifted": _percent_above_zero(below, np.pi, 2 * np.pi),
        f"{case}_rear_lowest": lowest,
        f"{case}_lift_friction": 2 * shaft.cart.guide_friction * abs(lowest),  # f (|N11| + |N12|) - f (N11 + N12)
    }
