"""The published machine, engineering method (D ch. 1) and four-cart crank (C), for formulas of `data/published.csv`.

Values are SI units and dimensionless numbers.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact import contact
from compact.engines.halfplane import LineContact
from compact.machine.cart import Cart, balance
from compact.machine.crankshaft import (
    CRANK_ANGLES,
    CrankshaftRevolution,
    simulate_crankshaft,
)
from compact.machine.rigid_drive import Crank, DriveState
from compact.numerics import Array
from compact.numerics.piecewise import find_maximum, find_roots, integrate, interior_grid

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
STATED_FORCE = ROLLERS * INTERACTION_FORCE  # [N], resistance of a cart
SMOOTH, MASSLESS = replace(CART, guide_friction=0.0), replace(CART, mass=0.0)
USED, USED_SPEED = replace(SMOOTH, mass=0.0), 100 * 2 * np.pi / 60  # data evidently used; [rad/s]
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
TOWARDS, AWAY = np.array([0.0, np.pi]), np.array([np.pi, 2 * np.pi])  # [rad], strokes to the crank and back
STEPS = 361  # [-], cells between which a reaction changes its sign
Quantity = Callable[[DriveState], Array]  # of a cart, at the samples


class Method:
    """Engineering method, (1.4)-(1.9), at the operating point.

    Parameters
    ----------
    friction : float
        Friction of mix on steel [-].
    modulus : float
        Contact modulus [Pa].
    """

    def __init__(self, friction: float = STEEL_FRICTION, modulus: float = MODULUS) -> None:
        self.exponent = contact.pressure_exponent(POISSON, friction)
        self.angle = contact.capture_angle(PRESSURE, modulus, POISSON, self.exponent)
        mix = (self.angle, modulus, POISSON, self.exponent, CART.roller_radius, ROLLER_LENGTH)
        self.force, self.one_sided = contact.roller_force(*mix), contact.roller_force(*mix, one_sided=True)
        self.length = contact.contact_length(self.angle, CART.roller_radius, self.exponent)

    @cached_property
    def resistance(self) -> Any:
        """Resistance of one roller [N]."""
        radius = CART.roller_radius
        return contact.roller_resistance(self.force, self.length, radius, self.exponent, ROLLER_FRICTION)

    @cached_property
    def cart_resistance(self) -> Any:
        """Resistance of one cart [N]."""
        return contact.cart_resistance(self.force, self.resistance, ROLLERS, CART.weight, **GUIDES)

    @property
    def hertz(self) -> LineContact:
        """Hertz's contact of the same capture angle."""
        radius, modulus = CART.roller_radius, MODULUS / (1 - POISSON**2)
        return contact.hertz(radius=radius, contact_modulus=modulus, half_width=radius * math.sin(self.angle))


def fitted_modulus() -> float:
    """Compute the modulus at which F of (1.6) is the printed reaction [Pa]; at given q it goes as 1/E."""
    return float(MODULUS * Method(0.0).force / ROLLER_REACTION)


def guide_friction() -> float:
    """Compute the guide friction of a cart within its moving force [N]."""
    return float(balance(CART, 0.0, MOVING_FORCE, 1.0).guide_friction)


@cache
def turn(
    cart: Cart = CART, resistance: float = STATED_FORCE, carts: int = 1, speed: float = ANGULAR_SPEED
) -> CrankshaftRevolution:
    """Compute one turn of carts at their standard angles against a constant resistance [N] each."""
    return simulate_crankshaft(cart, CRANK, speed, contact.dry_resistance(resistance), CRANK_ANGLES[carts])


def mean_power(turned: CrankshaftRevolution) -> float:
    """Compute the mean power [W]; for a constant resistance W it is 4 r W w/(2 pi), whatever rod and mass."""
    return turned.mean(turned.power)


@cache
def stated_mean() -> float:
    """Compute the mean power of the stated cart [W], whose rear guide wheel lifts off."""
    breaks = [*TOWARDS, *_roots(turn(), AWAY, rear), AWAY[1]]
    return integrate(lambda psi: _cart(turn(), psi).drive_power, breaks) / (2 * np.pi)


def peak_over_mean(mass: float, carts: int = 1) -> float:
    """Compute the peak power of carts of a mass [kg] over their mean power [-], without guide friction."""
    return turn(replace(SMOOTH, mass=mass), STATED_FORCE, carts).peak_power / (carts * mean_power(turn(SMOOTH)))


@cache
def mass_for_ratio() -> float:
    """Compute the mass [kg] at which four carts have the printed peak over mean power."""
    return brentq(lambda mass: peak_over_mean(mass, 4) - PRINTED_SUM_OVER_MEAN, 2000.0, 3000.0, xtol=1e-10)


def dead_centre() -> float:
    """Compute the acceleration at the dead centre [m/s2]."""
    return float(turn().shaft.cycle.derivative(0.0, 2))


def mean_on_upper_rail(towards: float, away: float) -> float:
    """Compute the mean power [W] by H of C (9): guide wheels on the upper rail even where their reaction is negative.

    Resistance and friction have the given directions on both strokes.
    """
    lift = np.sum(CART.roller_reactions) - CART.weight

    def power(psi: Array) -> Array:
        direction = np.where(np.mod(psi, 2 * np.pi) < np.pi, towards, away)
        _, slope, curvature, _ = turn().shaft.travel(np.mod(psi, 2 * np.pi))
        slide = direction * CART.guide_friction
        needed = curvature * ANGULAR_SPEED**2 * CART.mass + direction * STATED_FORCE + slide * lift
        return needed / (1 - slide * np.tan(CRANK.rod_angle(psi))) * ANGULAR_SPEED * slope

    return integrate(power, [*TOWARDS, AWAY[1]]) / (2 * np.pi)


def largest(turned: CrankshaftRevolution, wheel: str, stroke: Array, sign: float = 1.0) -> float:
    """Compute the largest reaction [N] of a guide wheel on a stroke; the least for the sign -1."""
    reaction = attrgetter(f"forces.{wheel}_reaction")
    return sign * find_maximum(lambda psi: sign * reaction(_cart(turned, psi)), interior_grid(stroke))[0]


def percent(turned: CrankshaftRevolution, stroke: Array, quantity: Quantity) -> float:
    """Compute the part of a stroke on which a quantity is positive [%]."""
    edges = np.array([stroke[0], *_roots(turned, stroke, quantity), stroke[1]])
    above = quantity(_cart(turned, (edges[:-1] + edges[1:])[:, None] / 2)).ravel() > 0
    return 100 * float(np.sum(np.diff(edges)[above])) / np.pi


def rear(cart: DriveState) -> Array:
    """Return the reaction of the rear guide wheel [N]."""
    return cart.forces.rear_reaction


def lifted(cart: DriveState) -> Array:
    """Return a number that is positive where the rear guide wheel lifts off [N]."""
    return -rear(cart)


def rear_over_front(cart: DriveState) -> Array:
    """Return the difference of the reactions of the guide wheels [N]."""
    return rear(cart) - cart.forces.front_reaction


def _cart(turned: CrankshaftRevolution, psi: Array) -> DriveState:
    """Return the first cart at crank angles [rad] whose rows lie within one stroke."""
    return turned.shaft.uniform_states(np.atleast_2d(psi))[0]


def _roots(turned: CrankshaftRevolution, stroke: Array, quantity: Quantity) -> Array:
    def at(psi: Array) -> Array:
        return quantity(_cart(turned, psi)).reshape(psi.shape) if psi.size else psi  # the search ends with no angles

    return find_roots(at, np.linspace(stroke[0], stroke[1], STEPS))
