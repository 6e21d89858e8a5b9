"""Computed values for the published numbers of the machine: engineering method (D ch. 1) and four-cart crank (C).

Each function returns values by the name of their row in `data/published.csv`; `published_numbers` compares them.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.optimize import brentq

from compact import contact
from compact.machine.cart import Cart, balance
from compact.machine.crankshaft import (
    CRANK_ANGLES,
    CartRevolution,
    CrankshaftRevolution,
    crank_kinematics,
    simulate_crankshaft,
)
from compact.machine.rigid_drive import Crank
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
Quantity = Callable[[CartRevolution], Array]  # of a cart, at the samples
STEPS = 361  # [-], cells between which a reaction changes its sign


def engineering_numbers() -> dict[str, Any]:
    """Compute (1.1)-(1.10) and the mix parameters that follow from the published operating point."""
    chain, plain = _chain(STEEL_FRICTION, MODULUS), _chain(0.0, MODULUS)
    radius, force = CART.roller_radius, chain["force"]
    one = contact.roller_resistance(force, chain["length"], radius, chain["exponent"], ROLLER_FRICTION)
    whole = contact.cart_resistance(force, one, ROLLERS, CART.weight, **GUIDES)
    fitted = MODULUS * plain["force"] / ROLLER_REACTION  # F of (1.6) at given q goes as 1/E
    half_width = radius * math.sin(plain["capture_angle"])
    hertz = contact.hertz(radius=radius, youngs_modulus=MODULUS, poisson=POISSON, half_width=half_width)
    radii, rollers = contact.radius_range(HEIGHT), contact.rollers_needed(WIDTH, radius, FEEDER_SLEEVE, OVERLAP)
    guides = float(balance(CART, 0.0, MOVING_FORCE, 1.0).guide_friction)
    return chain | {
        "roller_resistance": one,
        "cart_resistance": whole,
        "power": contact.cart_power(whole, VELOCITY),
        "angle_over_hertz": hertz.peak_pressure / PRESSURE,
        "force_over_hertz": plain["force"] / (ROLLER_LENGTH * hertz.load),
        "plain_force": plain["force"],
        "plain_one_sided": plain["one_sided"],
        "fitted_ratio": PRESSURE**2 * (1 - POISSON**2) / fitted / 1e3,
        "fitted_modulus": fitted / 1e6,
        "fitted_angle": math.degrees(_chain(0.0, fitted)["capture_angle"]),
        "radius_low": radii.low,
        "radius_high": radii.high,
        "rollers": rollers,
        "stroke_as_needed": contact.stroke_needed(WIDTH, float(rollers), OVERLAP),
        "stroke_as_printed": contact.stroke_needed(WIDTH, ROLLERS, OVERLAP),
        "overlap_as_printed": 2 * CRANK.radius - contact.stroke_needed(WIDTH, ROLLERS, 0.0),
        "guide_friction": guides,
        "coefficient": (MOVING_FORCE - guides) / (ROLLERS * ROLLER_REACTION),
        "coefficient_high": (MOVING_FORCE - guides) / (ROLLERS * INTERACTION_FORCE),
        "half_moving_force": MOVING_FORCE / ROLLERS,
    }


def _chain(friction: float, modulus: float) -> dict[str, Any]:
    """Compute (1.4)-(1.7) at the operating point, by row name."""
    alpha = contact.pressure_exponent(POISSON, friction)
    angle = contact.capture_angle(PRESSURE, modulus, POISSON, alpha)
    mix = (angle, modulus, POISSON, alpha, CART.roller_radius, ROLLER_LENGTH)
    return {
        "exponent": alpha,
        "capture_angle": angle,
        "force": contact.roller_force(*mix),
        "one_sided": contact.roller_force(*mix, one_sided=True),
        "length": contact.contact_length(angle, CART.roller_radius, alpha),
    }


def _turn(cart: Cart, resistance: float, carts: int = 1, speed: float = ANGULAR_SPEED) -> CrankshaftRevolution:
    """Compute one turn of carts at their standard angles against a constant resistance [N] each."""
    return simulate_crankshaft(cart, CRANK, speed, contact.dry_resistance(resistance), CRANK_ANGLES[carts])


def _cart(turn: CrankshaftRevolution, psi: Array) -> CartRevolution:
    """Return the first cart at crank angles [rad] whose rows lie within one stroke."""
    return turn.shaft.carts_at(np.atleast_2d(psi))[0]


def crank_numbers() -> dict[str, float]:
    """Compute powers and guide-wheel reactions of C for the stated data, and for the data evidently used."""
    force, smooth = ROLLERS * INTERACTION_FORCE, replace(CART, guide_friction=0.0)
    stated, four = _turn(CART, force), _turn(CART, force, 4)
    used, used_four = (_turn(replace(smooth, mass=0.0), MOVING_FORCE, n, 100 * 2 * np.pi / 60) for n in (1, 4))
    massless = _turn(replace(CART, mass=0.0), force)
    breaks = [*TOWARDS, *_roots(stated, AWAY, _rear), AWAY[1]]  # lift-offs of the rear guide wheel
    mean = integrate(lambda psi: _cart(stated, psi).power, breaks) / (2 * np.pi)

    # the mean power of a constant resistance W is 4 r W w/(2 pi) for any rod and mass
    plain, plain_four = _turn(smooth, force), _turn(smooth, force, 4)
    plain_mean = plain.mean(plain.power)
    dead_centre = ANGULAR_SPEED**2 * float(crank_kinematics(CRANK, np.asarray(0.0))[2])
    found = {
        **_powers("stated", stated.peak_power, mean, four.peak_power, 4 * mean),
        **_powers(
            "used", used.peak_power, used.mean(used.power), used_four.peak_power, used_four.mean(used_four.power)
        ),
        "quarter_mean_over_mean": plain_four.mean(plain_four.power) / 4 / plain_mean,
        "mean_frictionless": plain_mean,
        "mean_upper_rail": _mean_on_upper_rail(1.0, -1.0),
        "mean_literal": _mean_on_upper_rail(1.0, 1.0),
        "resistance_of_mean": force * PRINTED_MEAN_POWER / plain_mean,
        "dead_centre": dead_centre,
        "inertia": CART.mass * dead_centre,
        "peak_of_moving_force": _turn(CART, MOVING_FORCE).peak_power,
        "peak_of_moving_force_plain": _turn(smooth, MOVING_FORCE).peak_power,
    }

    def peak_over_mean(mass: float, carts: int) -> float:
        return _turn(replace(smooth, mass=mass), force, carts).peak_power / (carts * plain_mean)

    mass = brentq(lambda mass: peak_over_mean(mass, 4) - PRINTED_SUM_OVER_MEAN, 2000.0, 3000.0, xtol=1e-10)
    found["inertia_for_ratio"] = mass * CRANK.radius * ANGULAR_SPEED**2 / force
    found["one_over_mean_then"] = peak_over_mean(mass, 1)

    for name, (key, sign) in product(("front", "rear"), (("largest", 1.0), ("least", -1.0))):
        found[f"{name}_{key}"] = sign * _largest(massless, name, sign, TOWARDS)
    for case, turn in (("stated", stated), ("massless", massless)):
        lowest = -_largest(turn, "rear", -1.0, AWAY)
        found |= {
            f"{case}_rear_greater": _percent(turn, TOWARDS, lambda cart: _rear(cart) - cart.forces.front_reaction),
            f"{case}_rear_lifted": _percent(turn, AWAY, lambda cart: -_rear(cart)),
            f"{case}_rear_lowest": lowest,
            f"{case}_lift_friction": 2 * CART.guide_friction * abs(lowest),  # f (|N11| + |N12|) - f (N11 + N12)
        }
    return found


def _powers(case: str, one_peak: float, one_mean: float, sum_peak: float, sum_mean: float) -> dict[str, float]:
    return {
        f"{case}_one_peak": one_peak,
        f"{case}_one_mean": one_mean,
        f"{case}_sum_peak": sum_peak,
        f"{case}_sum_mean": sum_mean,
        f"{case}_one_over_quarter": one_peak / (sum_peak / 4),
        f"{case}_sum_over_mean": sum_peak / sum_mean,
        f"{case}_one_over_mean": one_peak / one_mean,
    }


def _rear(cart: CartRevolution) -> Array:
    return cart.forces.rear_reaction


def _roots(turn: CrankshaftRevolution, stroke: Array, quantity: Quantity) -> Array:
    cells = np.linspace(stroke[0], stroke[1], STEPS)
    return find_roots(lambda psi: quantity(_cart(turn, psi)).reshape(psi.shape), cells)


def _mean_on_upper_rail(towards: float, away: float) -> float:
    """Compute the mean power [W] by H of C (9): guide wheels on the upper rail even where their reaction is negative.

    Resistance and friction have the given directions on both strokes.
    """
    force, lift = ROLLERS * INTERACTION_FORCE, np.sum(CART.roller_reactions) - CART.weight

    def power(psi: Array) -> Array:
        direction = np.where(np.mod(psi, 2 * np.pi) < np.pi, towards, away)
        _, slope, curvature = crank_kinematics(CRANK, psi)
        slide = direction * CART.guide_friction
        needed = curvature * ANGULAR_SPEED**2 * CART.mass + direction * force + slide * lift
        return needed / (1 - slide * np.tan(CRANK.rod_angle(psi))) * ANGULAR_SPEED * slope

    return integrate(power, [*TOWARDS, AWAY[1]]) / (2 * np.pi)


def _largest(turn: CrankshaftRevolution, name: str, sign: float, stroke: Array) -> float:
    """Compute the largest reaction [N] of a guide wheel times a sign on a stroke."""
    reaction = attrgetter(f"forces.{name}_reaction")
    return find_maximum(lambda psi: sign * reaction(_cart(turn, psi)), interior_grid(stroke))[0]


def _percent(turn: CrankshaftRevolution, stroke: Array, quantity: Quantity) -> float:
    """Compute the part of a stroke on which a quantity is positive [%]."""
    edges = np.array([stroke[0], *_roots(turn, stroke, quantity), stroke[1]])
    above = quantity(_cart(turn, (edges[:-1] + edges[1:])[:, None] / 2)).ravel() > 0
    return 100 * float(np.sum(np.diff(edges)[above])) / np.pi
