"""Loose mix at its limit: shear under a feed sleeve, and the pressure that squeezes mix out towards the empty mould.

A feed sleeve of the width B_T along the travel and the roller length L is a silo whose bottom is the bed. The moving
cart shears the mix that stands in it over the bed. Its walls carry part of the weight (Janssen):

    s_J = g rho D/(4 mu K) [1 - exp(-4 mu K H/D)],    D = 2 B_T L/(B_T + L),    F_s = s_J B_T L tan phi

with the head H, the bulk density rho of the loose mix, the friction mu on the wall, the hydraulic diameter D and the
angle of internal friction phi. At rest the earth pressure coefficient is K = 1 - sin phi (Jaky). Mix that flows to a
moving opening is pressed against the walls, K = tan^2(45 deg + phi/2), and its stress on the bed is the least. Neither
contains cohesion, or mix that leaves the sleeve.

Mix under the roller evades along its axis where it pushes the tongue, a slope of the repose angle psi, along a plane
that rises at the angle theta from the base. The wedge above the plane has the length x along the base and the weight W,

    H(theta) = [W sin(theta + phi) + c x cos phi/cos theta]/cos(theta + phi),    x = h/(tan theta + tan psi)

and the thrust on its vertical face is at most the least H. The mix under the roller yields between both,

    p_ext = N H/h + 2 c sqrt(N),    N = tan^2(45 deg + phi/2)

The mechanism is kinematic, so that H is an upper bound for associated mix without friction on the vertical face.

References
----------
H. A. Janssen, Versuche ueber Getreidedruck in Silozellen, Z. VDI 39 (1895) 1045-1049; J. Jaky, The coefficient of earth
pressure at rest, J. Soc. Hung. Eng. Arch. 78 (1944) 355-358; C. A. Coulomb, Mem. Acad. Roy. Pres. Div. Sav. 7 (1776).
"""

import numpy as np

GRAVITY = 9.80665  # [m/s2], standard acceleration of gravity
REPOSE_ANGLE = 35.0  # [deg], of the tongue
PLANES = np.radians(np.linspace(0.0, 45.0, 91))  # [rad], of the wedge; the bound is the least of them


def bed_stress(
    width: float, length: float, head: float, wall_friction: float, density: float, lateral_ratio: float
) -> float:
    """Compute the vertical stress on the bed below a sleeve full of loose mix [Pa].

    Parameters
    ----------
    width : float
        Width B_T along the travel [m].
    length : float
        Length along the roller [m].
    head : float
        Height H of the mix above the bed [m].
    wall_friction : float
        Friction coefficient mu of mix on the wall [-]; 0 for a smooth wall, which carries no weight.
    density : float
        Bulk density of the loose mix [kg/m3].
    lateral_ratio : float
        Lateral over vertical stress K [-].

    Examples
    --------
    >>> f"{bed_stress(0.18, 1.164, 1.0, 0.35, 1700.0, 0.43):.0f} Pa"
    '7382 Pa'
    """
    diameter = 2 * width * length / (width + length)
    decay = 4 * wall_friction * lateral_ratio * head / diameter
    return float(GRAVITY * density * head * (-np.expm1(-decay) / decay if decay else 1.0))


def sleeve_drag(
    width: float, length: float, head: float, wall_friction: float, density: float, angle: float, flowing: bool = False
) -> float:
    """Compute the shear force of the bed on the mix of one sleeve [N].

    Parameters
    ----------
    width, length, head, wall_friction, density
        See `bed_stress`.
    angle : float
        Angle of internal friction [deg], between 0 and 90.
    flowing : bool
        True for mix that flows to a moving opening, the lower end; False for mix at rest.
    """
    ratio = passive_ratio(angle) if flowing else float(1 - np.sin(np.radians(angle)))
    stress = bed_stress(width, length, head, wall_friction, density, ratio)
    return float(stress * width * length * np.tan(np.radians(angle)))


def passive_ratio(friction_angle: float) -> float:
    """Return the largest over the least principal stress of yielding mix without cohesion [-]."""
    return float(np.tan(np.radians(45 + friction_angle / 2)) ** 2)


def extrusion_pressure(height: float, bulk_density: float, friction_angle: float, cohesion: float) -> float:
    """Compute the vertical stress at which mix under the roller pushes the tongue out [Pa].

    Parameters
    ----------
    height : float
        Height h of the tongue [m].
    bulk_density : float
        Bulk density of the loose mix [kg/m3].
    friction_angle, cohesion : float
        phi [deg] and c [Pa] of the loose mix.

    Examples
    --------
    >>> f"{extrusion_pressure(0.22, 1700.0, 35.0, 10e3) / 1e3:.0f} kPa"
    '96 kPa'
    """
    angle, ratio = np.radians(friction_angle), passive_ratio(friction_angle)
    planes = PLANES[PLANES + angle < np.radians(89)]
    length = height / (np.tan(planes) + np.tan(np.radians(REPOSE_ANGLE)))
    weight = GRAVITY * bulk_density * height * length / 2
    held = cohesion * length / np.cos(planes) * np.cos(angle)
    thrust = float(((weight * np.sin(planes + angle) + held) / np.cos(planes + angle)).min())
    return ratio * thrust / height + 2 * cohesion * float(np.sqrt(ratio))
