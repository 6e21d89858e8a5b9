"""Carts, motors, laws and resistances that the tests of the machine share."""

from dataclasses import replace

import numpy as np
from published import CART_OF_C

from compact.machine.hydraulic_drive import Hydraulic
from compact.machine.shaft import Kloss
from compact.motion.profile import law

CART = replace(CART_OF_C, guide_friction=0.0)
MASS, SIZE = CART.mass, 3486.0  # [kg], and of the dry friction [N]
KLOSS = Kloss(breakdown_torque=40.0, breakdown_slip=0.15, synchronous_speed=157.0)
HYDRAULIC = Hydraulic(
    piston_area=1e-3, supply_pressure=8e6, pump_flow=5e-4, valve_area=2e-5, discharge_coefficient=0.62,
    oil_density=870.0, transition_drop=1e3, bulk_modulus=1.4e9, dead_volume=1e-4,
)  # fmt: skip


def published_law(name, duration=3.0, **shape):
    return law(name, stroke=0.4, duration=duration, rod_length=0.8, **shape)


def free(velocity, acceleration):
    return np.zeros_like(velocity)


def friction(size):
    """Dry friction of a size [N]."""
    return lambda velocity, acceleration=0.0: size * np.sign(velocity)


dry = friction(SIZE)


def stribeck(velocity, acceleration):
    """Stribeck friction, smooth on each side of speed 0."""
    speed = np.abs(velocity)
    return np.sign(velocity) * (2000 + 1500 * np.exp(-speed / 0.05) + 4000 * speed**2)
