"""Independent sum of the moments on a cart, wheel by wheel."""

import numpy as np


def moment_residual(cart, forces, resistance, direction, rod_tangent=0.0):
    """Residual moment about the pin [N m]; zero for a `Balance`. The arguments are those of `balance`."""
    rollers = np.where(np.asarray(direction) < 0, cart.return_load_ratio, 1.0)
    rollers = rollers * np.dot(cart.roller_reactions, cart.roller_positions)
    mix = -np.asarray(resistance) * (cart.pin_height + cart.roller_radius)
    rod = cart.pin_position * forces.drive_force * rod_tangent
    guides = np.zeros(())
    for x, reaction in zip(cart.guide_positions, (forces.front_reaction, forces.rear_reaction), strict=True):
        rail = np.sign(reaction) * cart.guide_wheel_diameter / 2  # the wheel is in contact with the loaded rail
        guides = guides - reaction * x + rail * direction * cart.guide_friction * np.abs(reaction)
    return rollers + mix + rod + guides
