"""Computed values for the published numbers of the machine: engineering method (D ch. 1) and four-cart crank (C).

Each public function returns values by the name of their row in `data/published.csv`; `published_numbers` compares them
with the print.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from compact import contact
from compact.machine.cart import Balance, Cart, balance
from compact.machine.crankshaft import CRANK_ANGLES, CrankshaftRevolution, crank_kinematics, simulate_crankshaft
from compact.machine.rigid_drive import Crank
from compact.numerics.piecewise import integrate

Values = float | NDArray[np.float64]
Function = Callable[[Values], NDArray[np.float64]]


# Machine of source C; feeder sleeve and overlap are unpublished and chosen so that 3 rollers satisfy (1.2), (1.3) and
# the stroke.
CART = Cart(
    mass=1000.0, weight=10e3, roller_positions=(0.27, -0.27), roller_reactions=(9740.0, 9740.0),
    guide_positions=(0.37, -0.37), pin_position=0.65, pin_height=0.1, roller_radius=0.11,
    guide_wheel_diameter=0.046, guide_friction=0.008,
)  # fmt: skip
CRANK, ANGULAR_SPEED = Crank(radius=0.2, rod_length=0.8), 10.5  # [rad/s]
ROLLERS, ROLLER_REACTION, INTERACTION_FORCE = 2, 9740.0, 7962.0  # [-] of a cart, [N] vertical, [N] along the travel
MOVING_FORCE = 3562.0  # [N], of the cart with its rollers, guide friction included
WIDTH, HEIGHT, FEEDER_SLEEVE, OVERLAP = 1.164, 0.22, 0.18, 0.012  # [m], of the product along the travel and upright
# Operating point of (1.4)-(1.10): prior of the mix at moisture content 0.10, density ratio 0.98, not published.
PRESSURE, MODULUS, POISSON, STEEL_FRICTION = 0.203e6, 0.75e6, 0.3, 0.35  # [Pa], [Pa], [-], [-]
ROLLER_LENGTH = 1.164  # [m], assumed; no source states it, pressures and moduli scale with its inverse
ROLLER_FRICTION = 0.12 + 0.05  # [-], f2 + f3 of (1.8)
GUIDES = {  # arguments of (1.9) [-], [m]
    "bearing_friction": 0.05, "journal_diameter": 0.02, "rolling_arm": 5e-4, "wheel_diameter": 0.046, "rib_factor": 1.5,
}  # fmt: skip
VELOCITY = 0.16  # [m/s], of (1.10)
PRINTED_MEAN_POWER, PRINTED_SUM_OVER_MEAN = 4738.8, 21872.2 / 18993.8  # [W] of a cart, [-] of four carts; C


def engineering_numbers() -> dict[str, Any]:
    """Compute (1.1)-(1.10) and the mix parameters that follow from the published operating point."""
    no_friction = _chain(0.0, MODULUS)
    fitted = MODULUS * no_friction["force"] / ROLLER_REACTION  # F of (1.6) at given q goes as 1/E
    radius = CART.roller_radius
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


def _chain(friction: float, modulus: float) -> dict[str, Any]:
    """Compute (1.4)-(1.7) at the operating point, by row name."""
    radius = CART.roller_radius
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


def _regression() -> dict[str, Any]:
    chain = _chain(STEEL_FRICTION, MODULUS)
    force, radius = chain["force"], CART.roller_radius
    one = contact.roller_resistance(force, chain["length"], radius, chain["exponent"], ROLLER_FRICTION)
    whole = contact.cart_resistance(force, one, ROLLERS, CART.weight, **GUIDES)
    return chain | {"roller_resistance": one, "cart_resistance": whole, "power": contact.cart_power(whole, VELOCITY)}


def _size_of_machine() -> dict[str, Any]:
    """Compute radius and number of rollers and the stroke by (1.1)-(1.3)."""
    radius, stroke = contact.radius_range(HEIGHT), 2 * CRANK.radius
    rollers = contact.rollers_needed(WIDTH, CART.roller_radius, FEEDER_SLEEVE, OVERLAP)
    return {
        "radius_low": radius.low,
        "radius_high": radius.high,
        "rollers": rollers,
        "stroke_as_needed": contact.stroke_needed(WIDTH, float(rollers), OVERLAP),
        "stroke_as_printed": contact.stroke_needed(WIDTH, ROLLERS, OVERLAP),
        "overlap_as_printed": stroke - contact.stroke_needed(WIDTH, ROLLERS, 0.0),
    }


def _resistance_coefficients() -> dict[str, Any]:
    """Compute rolling-resistance coefficients from the moving force less the friction of the guides."""
    guides = float(balance(CART, 0.0, MOVING_FORCE, 1.0).guide_friction)
    mix = MOVING_FORCE - guides
    return {
        "guide_friction": guides,
        "coefficient": mix / (ROLLERS * ROLLER_REACTION),
        "coefficient_high": mix / (ROLLERS * INTERACTION_FORCE),
        "half_moving_force": MOVING_FORCE / ROLLERS,
    }


@dataclass(frozen=True)
class _Shaft:
    """Carts of C on a shaft at constant speed, against a constant resistance [N]; crank angles psi [rad]."""

    resistance: float
    cart: Cart = CART
    speed: float = ANGULAR_SPEED
    crank: Crank = CRANK

    def turn(self, carts: int) -> CrankshaftRevolution:
        """Compute one turn with a number of carts at their standard angles."""
        resistance = contact.dry_resistance(self.resistance)
        return simulate_crankshaft(self.cart, self.crank, self.speed, resistance, CRANK_ANGLES[carts])

    def forces(self, psi: Values, direction: Values) -> Balance:
        """Compute the force balance of one cart; direction +1 towards the crank, -1 away."""
        acceleration = self.speed**2 * crank_kinematics(self.crank, np.asarray(psi))[2]
        tangent = np.tan(self.crank.rod_angle(psi))
        return balance(self.cart, acceleration, direction * self.resistance, direction, tangent)

    def force_on_upper_rail(self, psi: Values, direction: Values) -> NDArray[np.float64]:
        """Compute H of C (9) [N]: guide wheels on the upper rail even where their reaction is negative."""
        pull = crank_kinematics(self.crank, np.asarray(psi))[2] * self.speed**2 * self.cart.mass
        slide = direction * self.cart.guide_friction
        lift = np.sum(self.cart.roller_reactions) - self.cart.weight
        needed = pull + direction * self.resistance + slide * lift
        return needed / (1 - slide * np.tan(self.crank.rod_angle(psi)))

    def power(self, psi: Values, carts: int = 1) -> NDArray[np.float64]:
        """Compute the power of a number of carts [W] at any crank angle."""
        ahead = np.add.outer(CRANK_ANGLES[carts], psi)
        drive_force = self.forces(ahead, _direction(ahead)).drive_force
        return np.sum(drive_force * self.speed * crank_kinematics(self.crank, ahead)[1], axis=0)

    def peak(self, carts: int = 1) -> float:
        """Compute the peak power [W]."""
        return _largest(lambda psi: self.power(psi, carts), 0.0, 2 * np.pi)

    def mean(self) -> float:
        """Compute the mean power of one cart [W], piecewise between lift-offs of the rear guide wheel."""
        lifts = _crossings(lambda psi: self.forces(psi, -1.0).rear_reaction, np.pi, 2 * np.pi)
        return integrate(self.power, [0.0, np.pi, *lifts, 2 * np.pi]) / (2 * np.pi)

    def mean_of(self, force: Function) -> float:
        """Compute the mean power [W] of a drive force, a function of psi."""

        def power(psi: Values) -> NDArray[np.float64]:
            return force(psi) * self.speed * crank_kinematics(self.crank, np.asarray(psi))[1]

        return integrate(power, [0.0, np.pi, 2 * np.pi]) / (2 * np.pi)


def _direction(psi: Values) -> NDArray[np.float64]:
    return np.where(np.mod(psi, 2 * np.pi) < np.pi, 1.0, -1.0)


def _largest(function: Function, low: float, high: float) -> float:
    """Compute the maximum on [low, high] by grid refinement."""
    for _ in range(4):
        grid = np.linspace(low, high, 721)
        values = function(grid)
        best = int(np.argmax(values))
        low, high = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    return values[best]


def _crossings(function: Function, low: float, high: float) -> list[float]:
    """Compute the zeros of a continuous function on [low, high]."""
    grid = np.linspace(low, high, 361)
    change = np.flatnonzero(np.diff(np.sign(function(grid))))
    return [brentq(function, grid[i], grid[i + 1], xtol=1e-14) for i in change]


def _percent_above_zero(function: Function, low: float, high: float) -> float:
    edges = np.array([low, *_crossings(function, low, high), high])
    above = function((edges[:-1] + edges[1:]) / 2) > 0
    return 100 * np.sum(np.diff(edges)[above]) / (high - low)


def crank_numbers() -> dict[str, Any]:
    """Compute powers and guide-wheel reactions of C for the stated data, and for the data evidently used."""
    stated = _Shaft(ROLLERS * INTERACTION_FORCE)
    bare = replace(CART, mass=0.0, guide_friction=0.0)
    used = _Shaft(MOVING_FORCE, bare, speed=100 * 2 * np.pi / 60)
    one, four = used.turn(1), used.turn(4)
    massless = replace(stated, cart=replace(CART, mass=0.0))
    return {
        **_four_powers("stated", stated.peak(), stated.mean(), stated.peak(4), 4 * stated.mean()),
        **_four_powers("used", used.peak(), one.mean(one.power), four.power.max(), four.mean(four.power)),
        **_energy_balance(stated),
        **_inertia(stated),
        **_forward_reactions(massless),
        **_lift_off("stated", stated),
        **_lift_off("massless", massless),
    }


def _four_powers(case: str, one_peak: float, one_mean: float, sum_peak: float, sum_mean: float) -> dict[str, Any]:
    return {
        f"{case}_one_peak": one_peak,
        f"{case}_one_mean": one_mean,
        f"{case}_sum_peak": sum_peak,
        f"{case}_sum_mean": sum_mean,
        f"{case}_one_over_quarter": one_peak / (sum_peak / 4),
        f"{case}_sum_over_mean": sum_peak / sum_mean,
        f"{case}_one_over_mean": one_peak / one_mean,
    }


def _energy_balance(stated: _Shaft) -> dict[str, Any]:
    """Compute mean powers; for a constant resistance W the work of a turn is 4 r W for any rod and mass."""
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


def _inertia(stated: _Shaft) -> dict[str, Any]:
    """Compute inertia forces at the outer dead centre, and the mass that gives the printed ratio of powers."""
    dead_centre = stated.speed**2 * float(crank_kinematics(stated.crank, np.asarray(0.0))[2])
    moving = replace(stated, resistance=MOVING_FORCE)
    plain = replace(stated.cart, guide_friction=0.0)
    four = 4 * stated.resistance * 4 * stated.crank.radius * stated.speed / (2 * np.pi)

    def heavy(mass: float) -> _Shaft:
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


def _forward_reactions(shaft: _Shaft) -> dict[str, Any]:
    """Compute extremes of N11 (front) and N12 (rear) on the stroke towards the crank [N]."""

    def extreme(name: str, sign: float) -> float:
        return sign * _largest(lambda psi: sign * getattr(shaft.forces(psi, 1.0), f"{name}_reaction"), 0.0, np.pi)

    ends = {"least": -1.0, "largest": 1.0}
    return {f"{name}_{end}": extreme(name, sign) for name in ("front", "rear") for end, sign in ends.items()}


def _lift_off(case: str, shaft: _Shaft) -> dict[str, Any]:
    """Compute the shares of the strokes with N12 > N11 and with N12 < 0, and the added guide friction [N]."""

    def surplus(psi: Values) -> NDArray[np.float64]:
        forces = shaft.forces(psi, 1.0)
        return forces.rear_reaction - forces.front_reaction

    def below(psi: Values) -> NDArray[np.float64]:
        return -shaft.forces(psi, -1.0).rear_reaction

    lowest = -_largest(below, np.pi, 2 * np.pi)
    return {
        f"{case}_rear_greater": _percent_above_zero(surplus, 0.0, np.pi),
        f"{case}_rear_lifted": _percent_above_zero(below, np.pi, 2 * np.pi),
        f"{case}_rear_lowest": lowest,
        f"{case}_lift_friction": 2 * shaft.cart.guide_friction * abs(lowest),  # f (|N11| + |N12|) - f (N11 + N12)
    }
