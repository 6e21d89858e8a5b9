"""Rolling over compacting mix coupled with its pore air at the held height of the roller.

The excess pressure p - p0 of the air acts as an external load on the skeleton. The force on each node is

    int (p - p0) J F^-T grad N dV

After each step of travel the pressure is solved for the deformed layer; half of its change is applied in the next
step. The steady state is that of `steady_search`, so that the contact pressure is the total stress on the roller.
Friction of a turning roller is limited by the total pressure.
"""

from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.engine import CompactionContactResult
from compact.engines.compaction.increment_solver import IncrementSolver
from compact.engines.compaction.rolling import DAMPING, IncrementalRolling, RollingStep
from compact.engines.compaction.rolling_case import DepthTarget, RollingCase, RollingNumerics
from compact.engines.compaction.steady_search import SteadySearch
from compact.engines.compaction.steady_state import Relaxation
from compact.engines.pore_air import AirForces
from compact.engines.pore_air.steady_flow import AirPressure, RollerAir
from compact.material.pore_air import PoreAir
from compact.numerics import Array

COUPLED_TOLERANCE = 1e-2  # [-], distance to the steady state; the air changes load and resistance by tens of per cent
RELAXATION = 0.5  # [-], share of the change of the pressure that the next step applies


class CoupledContact(NamedTuple):
    """Steady contact coupled with the pore air.

    Parameters
    ----------
    changes : AirForces
        Changes of the total forces on the roller, those of skeleton and air, and the excess pressure behind.
    pressure : AirPressure
        Pressure of the air.
    rolling : CoupledRolling
        Steady solution.
    relaxation : Relaxation
        Slow relaxation of the bow wave of the solution.
    """

    changes: AirForces
    pressure: AirPressure
    rolling: "CoupledRolling"
    relaxation: Relaxation


def roll_coupled(
    contact: CompactionContactResult, air: PoreAir, speed: float, *, start: CoupledContact | None = None
) -> CoupledContact:
    """Compute the steady contact with its pore air at the height of a contact without.

    Parameters
    ----------
    contact : CompactionContactResult
        Contact without air; its yield pressure, hence the speed of its rate factor, is kept.
    air : PoreAir
        Pore air with its permeability.
    speed : float
        Speed of the roller at which the air flows [m/s], not 0.
    start : CoupledContact, optional
        Coupled contact of the same skeleton at a lower speed or a higher permeability, as initial guess.

    Returns
    -------
    CoupledContact

    Raises
    ------
    HeapingError
        If the bow wave grows without a steady state.
    RuntimeError
        If no equilibrium is found or the motion does not become steady.
    """
    depth = contact.indentation
    roller = replace(contact.roller, indentation=depth, load=None, peak_pressure=None)
    numerics, fed_layer = RollingNumerics(steady_tolerance=COUPLED_TOLERANCE), contact.solution.frame.inflow
    case = RollingCase(contact.layer, roller, contact.material, contact.speed, None, fed_layer, numerics)
    rolling = CoupledRolling(contact.solution if start is None else start.rolling, air, abs(speed))
    search = SteadySearch(DepthTarget(case), rolling, depth)
    search.relaxation = contact.relaxation if start is None else start.relaxation
    with threadpool_limits(1):
        search.run()
    search.require_steady()
    found = search.rolling
    assert isinstance(found, CoupledRolling)  # a copy of it
    step, of_air = found.steps[-1], RollerAir(found, air)
    pressure = of_air.pressure(speed)
    load = step.load - contact.load / contact.load_factor  # on the same mesh
    resistance = float(np.sign(speed)) * step.resistance - contact.resistance
    changes = AirForces(load, resistance, of_air.forces(pressure).excess_behind)
    return CoupledContact(changes, pressure, found, search.relaxation)


class CoupledRolling(IncrementalRolling):
    """Incremental rolling that solves for the pressure of the air after each step.

    Parameters
    ----------
    other : IncrementalRolling
        Steady solution from which it continues.
    air : PoreAir
        Pore air with its permeability.
    speed : float
        Speed of the roller [m/s], > 0.

    Attributes
    ----------
    excess : ndarray, shape (n,)
        Excess pressure that the next step applies at the Gauss points [Pa].
    """

    def __init__(self, other: IncrementalRolling, air: PoreAir, speed: float) -> None:
        self.__dict__.update(other.__dict__)
        self.frame = copy(other.frame)
        self.frame.solid = copy(other.frame.solid)
        self.solver = IncrementSolver(self.frame.solid, self.frame.surface_nodes, other.solver.tolerance)
        self.air, self.speed = air, speed
        if not isinstance(other, CoupledRolling):
            self.excess = np.zeros(len(self.frame.solid.point_areas))

    def advance(self, bottom_height: float, damping: float = DAMPING) -> RollingStep:
        """Roll by one element under the present pressure of the air, and solve for that of the next step.

        Parameters and result are those of the base class.
        """
        self.frame.solid.air_forces = self._air_forces()
        step = super().advance(bottom_height, damping)
        of_air = RollerAir(self, self.air)
        self.excess = self.excess + RELAXATION * (of_air.at_points(of_air.pressure(self.speed)) - self.excess)
        return step

    def _air_forces(self) -> Array:
        """Nodal forces of the excess pressure on the present displacement [N/m], shape (elements, 16)."""
        solid = self.frame.solid
        xx, xy, yx, yy = (solid.displacement_gradient(self.state.displacement) + np.array([1.0, 0, 0, 1.0])).T
        # J F^-T of the points, by the components of the force and of the gradient
        cofactor = np.array([[yy, -yx], [-xy, xx]]).transpose(2, 0, 1) if solid.finite else np.eye(2)[None]
        weighted = (self.excess * solid.point_areas)[:, None, None] * cofactor
        weighted = weighted.reshape(*solid.shape_gradients.shape[:2], 2, 2)
        forces = np.einsum("epij,epaj->eai", weighted, solid.shape_gradients)
        return np.asarray(forces.reshape(solid.element_dofs.shape))
