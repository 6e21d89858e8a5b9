"""Rolling over compacting mix coupled with its pore air at the held height of the roller.

The excess pressure p - p0 of the air acts as an external load on the skeleton. The force on each node is

    int (p - p0) J F^-T grad N dV

After each step of travel the pressure is solved for the deformed layer; half of its change is applied in the next
step. The steady state is that of `steady_search`, so that the contact pressure is the total stress on the roller.
Friction of a turning roller is limited by the total pressure.
"""

from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from compact.engines.compaction.depth_target import DepthTarget
from compact.engines.compaction.engine import CompactionContactResult
from compact.engines.compaction.finite_strain_solid import FiniteStrainSolid, SolidIncrement
from compact.engines.compaction.increment_solver import IncrementSolver
from compact.engines.compaction.rolling import DAMPING, IncrementalRolling, RollingStep
from compact.engines.compaction.rolling_case import RollingCase, RollingNumerics
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
    contact: CompactionContactResult,
    air: PoreAir,
    speed: float,
    *,
    start: CoupledContact | None = None,
    steady_tolerance: float = COUPLED_TOLERANCE,
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
    steady_tolerance : float
        Relative tolerance of the steady state [-].

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
    target = DepthTarget(contact.layer, roller, contact.material, None, contact.solution.frame.inflow)
    case = RollingCase(
        contact.layer, roller, contact.material, contact.speed, None, contact.solution.frame.inflow, RollingNumerics()
    )
    search = SteadySearch(
        case,
        target,
        CoupledRolling(contact.solution if start is None else start.rolling, air, abs(speed)),
        depth,
        tolerance=steady_tolerance,
        target_tolerance=1.0,  # a depth is prescribed
        relaxation=contact.relaxation if start is None else start.relaxation,
    )
    with threadpool_limits(1):
        search.run()
    search.require_steady()
    rolling = search.rolling
    assert isinstance(rolling, CoupledRolling)  # copies of it
    step, of_air = rolling.steps[-1], RollerAir(rolling, air)
    pressure = of_air.pressure(speed)
    load = step.load - contact.load / contact.load_factor  # on the same mesh
    resistance = float(np.sign(speed)) * step.resistance - contact.resistance
    changes = AirForces(load, resistance, of_air.forces(pressure).excess_behind)
    return CoupledContact(changes, pressure, rolling, search.relaxation)


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
        self.frame.solid = AirLoadedSolid(other.frame.solid)
        self.solver = IncrementSolver(self.frame.solid, self.frame.surface_nodes, other.solver.tolerance)
        self.air, self.speed = air, speed
        if not isinstance(other, CoupledRolling):
            self.excess = np.zeros(len(self.frame.solid.point_areas))

    def advance(self, bottom_height: float, damping: float = DAMPING) -> RollingStep:
        """Roll by one element under the present pressure of the air, and solve for that of the next step.

        Parameters and result are those of the base class.
        """
        solid = self.frame.solid
        assert isinstance(solid, AirLoadedSolid)
        solid.set_excess(self.excess, self.state.displacement)
        step = super().advance(bottom_height, damping)
        of_air = RollerAir(self, self.air)
        self.excess = self.excess + RELAXATION * (of_air.at_points(of_air.pressure(self.speed)) - self.excess)
        return step


class AirLoadedSolid(FiniteStrainSolid):
    """Finite elements of a layer whose internal forces are those of the total stress.

    Parameters
    ----------
    solid : FiniteStrainSolid
        Finite elements of the skeleton.
    """

    def __init__(self, solid: FiniteStrainSolid) -> None:
        self.__dict__.update(solid.__dict__)
        self.air_forces = np.zeros(self.element_dofs.shape)

    def set_excess(self, excess: Array, displacement: Array) -> None:
        """Set the nodal forces of the air.

        Parameters
        ----------
        excess : ndarray, shape (n,)
            Excess pressure at the Gauss points [Pa].
        displacement : ndarray
            Displacement of the nodes on which it acts [m].
        """
        xx, xy, yx, yy = (self.displacement_gradient(displacement) + np.array([1.0, 0, 0, 1.0])).T
        # J F^-T of the points, by the components of the force and of the gradient
        cofactor = np.array([[yy, -yx], [-xy, xx]]).transpose(2, 0, 1) if self.finite else np.eye(2)[None]
        weighted = (excess * self.point_areas)[:, None, None] * cofactor
        gradients = self.shape_gradients
        weighted = weighted.reshape(*gradients.shape[:2], 2, 2)
        self.air_forces = np.einsum("epij,epaj->eai", weighted, gradients).reshape(self.element_dofs.shape)

    def increment(self, *given: Any, **options: Any) -> SolidIncrement:
        """Integrate the stresses from a state to a displacement, with the forces of the air.

        Parameters and result are those of the base class.
        """
        found = super().increment(*given, **options)
        return replace(found, element_forces=found.element_forces - self.air_forces)
