"""Values of this package for the formulas of `data/published.csv`: published machine, motion laws and cams.

The machine has the engineering method (D ch. 1) and the four-cart crank (C); the motion laws and their cams are those
of A, B and D. Values are SI units and dimensionless numbers.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache, cached_property
from itertools import product
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import brentq

from compact import contact
from compact.cams.profile import Cam, FlatFace, Pointed, least_breadth
from compact.engines.halfplane import LineContact
from compact.machine.cart import Cart, balance
from compact.machine.crankshaft import CRANK_ANGLES, CrankshaftRevolution, simulate_crankshaft
from compact.machine.rigid_drive import Crank, DriveState
from compact.machine.roller_motors import roller_rotation
from compact.motion.laws import minimiser, piecewise
from compact.motion.profile import Cycle, MotionProfile, law
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


STROKE, DURATION = 0.4, 3.0  # [m], [s], of D ch. 5
RUN_UP = DURATION / 6  # [s]
A, B = "reversal-4", "reversal-4-free-both"  # laws of the papers A and B
PRINTED_B_SPEED, PRINTED_B_SLOPE = 6 / 5, 87 / 80  # [-], of B (28) and (30), over stroke/duration
COARSE_SPEED = 1 / 0.86  # [-], of D 2.7 with 2/3 truncated to 0.66, over stroke/duration
EARLY = 0.1  # [-], phase within the run-up
FREE_BREADTH = ("cubic", "quintic", "septic", "complex", "reversal-2")  # their flat-faced cam needs the stroke only


@cache
def unit(name: str) -> MotionProfile:
    """Return a law of unit stroke and duration."""
    return law(name, 1.0, 1.0)


@cache
def printed(name: str) -> MotionProfile:
    """Return a law of the stroke and the duration of D ch. 5."""
    return law(name, STROKE, DURATION)


def wrong_closure(name: str) -> float:
    """Return the scale of the peaks at a steady speed at which the law misses the stroke [-]."""
    return (COARSE_SPEED if name == "combined-3" else PRINTED_B_SPEED) / unit(name).peaks().velocity


def jerk_jump(name: str) -> float:
    """Return the jump of the jerk at the reversal without a dwell [-]; 0 where the jerk is continuous."""
    steps = unit(name).discontinuities()
    return abs(sum(step.after - step.before for step in steps if step.time == 0 and step.order == 3))


def jerk_at_joins(name: str) -> float:
    """Return infinity for a law whose acceleration jumps between dwells, else 0."""
    return np.inf if any(join.order == 2 for join in printed(name).discontinuities("dwell")) else 0.0


def run_up_travel(name: str) -> float:
    """Return the travel of the run-up over that at the steady speed in the same time [-]."""
    return float(6 * unit(name).position(1 / 6) / unit(name).velocity(0.5))


def run_up_criterion(travel: float) -> float:
    """Compute J_4 of an acceleration phase of A over a travel, in unit time to unit speed."""
    run = minimiser(4, {0: 0, 1: 0, 2: 0, 3: 0}, {0: travel, 1: 1, 2: 0, 3: 0})
    return integrate(run.deriv(4) ** 2, [0.0, 1.0])


def best_run_up() -> float:
    """Compute the travel z of the acceleration of A, over that at the steady speed, with the least criterion [-].

    At fixed stroke the criterion is proportional to j/(z + 2)^2 with j = a z^2 + b z + c; its derivative is linear.
    """
    constant, half, whole = (run_up_criterion(travel) for travel in (0.0, 0.5, 1.0))
    square = 2 * (constant + whole - 2 * half)
    linear = whole - square - constant
    return 2 * (constant - linear) / (4 * square - linear)


def at_fixed_stroke(travel: float) -> float:
    """Compute the criterion of A at fixed stroke, up to a factor."""
    return run_up_criterion(travel) / (travel + 2) ** 2


def run_up_of_b() -> Polynomial:
    """Return the run-up of B in unit time to unit speed."""
    return minimiser(4, {0: 0, 1: 0, 3: 0}, {1: 1, 2: 0, 3: 0})


def lone_phase() -> Polynomial:
    """Return the optimal single phase of D 4.3."""
    return minimiser(4, {0: 0, 1: 0, 2: 0}, {1: 1, 2: 0, 3: 0})


def roller_speed(phase: float) -> float:
    """Return the angular speed of a roller of unit radius by B without slip [-]."""
    return roller_rotation(Cycle(unit(B)), roller_radius=1.0, time=[phase])[1][0]


@cache
def printed_law_of_b() -> MotionProfile:
    """Build the law of B (28)-(30) as printed, for D ch. 5: correct shapes at the wrong steady speed."""
    run = PRINTED_B_SPEED / 6 * run_up_of_b()(Polynomial([0, 6]))
    steady = Polynomial([run(1 / 6), PRINTED_B_SLOPE])
    curve = piecewise([1 / 6, 2 / 3, 1 / 6], [run, steady, 1 - run(Polynomial([1 / 6, -1]))])
    return MotionProfile("B as printed", STROKE, DURATION, curve)


def velocity_step(motion: MotionProfile | Cycle) -> float:
    """Return the largest jump of the velocity [m/s]."""
    return max(abs(join.after - join.before) for join in motion.discontinuities() if join.order == 1)


@cache
def cam(name: str) -> Cam:
    """Return the cam of a pointed follower, of twice the stroke in breadth; of B as printed without a name."""
    cycle = Cycle(unit(name)) if name else printed_law_of_b().cycle()
    return Cam(cycle, breadth=2.0 if name else 2 * STROKE, follower=Pointed())


def breadth(made: Cam) -> float:
    """Compute the largest rho(phi) + rho(phi + pi) over b [-]."""
    angle = np.linspace(0, np.pi, 361)
    return (made.radius(angle) + made.radius(angle + np.pi)).max() / made.breadth


def flat_breadth(name: str) -> float:
    """Compute the least breadth of a flat-faced cam over the stroke [-]."""
    return least_breadth(Cycle(unit(name)), FlatFace()).breadth


def return_radius(u: Array | float) -> Array:
    """Compute the radius of the cam of A less half its breadth on the return stroke, phi = 7 pi/6 + u pi/3 [-]."""
    return cam(A).radius(7 * np.pi / 6 + np.asarray(u) * np.pi / 3) - 1.0


def miss_of_return(*signs: tuple[float, float, float]) -> float:
    """Compute how far the nearest reading of the printed radius, 0.4 (a + b u) + c/2, is from that of the cam of A [-].

    Parameters
    ----------
    *signs : tuple of float
        Readings (a, b, c), as of A (42); by default every choice of signs, as of D (4.113).
    """
    u = np.linspace(0, 2, 41)
    readings = signs or product((1, -1), repeat=3)
    return min(np.abs(0.4 * (a + b * u) + c / 2 - return_radius(u)).max() for a, b, c in readings)
