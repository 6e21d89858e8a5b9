"""Pore air under a roller: its steady flow, and the load and resistance that it adds to those of the skeleton."""

from typing import NamedTuple


class AirForces(NamedTuple):
    """Changes of a contact by its pore air at one speed.

    Parameters
    ----------
    load, resistance : float
        Changes of load and resistance of the roller per unit length, in the direction of the travel [N/m].
    excess_behind : float
        Largest excess pressure behind the contact [Pa], 0 if there is none. The total stress on horizontal planes
        vanishes there, so that it is a tensile stress of the skeleton.
    """

    load: float
    resistance: float
    excess_behind: float


NO_FORCES = AirForces(0.0, 0.0, 0.0)
