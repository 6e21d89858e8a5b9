"""Hydraulic drive: two cylinders move the cart, one in each direction, and two throttle valves control its motion.

    H = A (p_in - p_out),   Q = A |v|,   Q = Cd a sqrt(2/rho) dp/(dp^2 + c^2)^(1/4)

A pump of constant flow with a relief valve at p_s feeds the driving cylinder through the inlet valve, dp = p_s - p_in.
The other cylinder discharges to the tank through the outlet valve, dp = p_out. Below the transition pressure drop c the
flow is laminar.

Pressures, flow and valve areas a follow from an imposed law. The outlet valve is fully open until the cart must be
decelerated, so that p_in is as low as possible. Compressibility, leakage and inertia of the oil and variation of Cd are
neglected.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from compact.machine.cart import Cart, Resistance
from compact.machine.rigid_drive import Rigid, Run, solved
from compact.motion.profile import Cycle
from compact.numerics import Array
from compact.numerics.validation import require_positive


@dataclass(frozen=True)
class Hydraulic(Rigid):
    """Pump, relief valve, cylinders and throttle valves.

    Parameters
    ----------
    piston_area, valve_area : float
        A, and area of a fully open throttle valve [m2].
    supply_pressure, transition_drop : float
        p_s of the relief valve, and pressure drop c at the transition to turbulent flow [Pa].
    pump_flow : float
        [m3/s].
    discharge_coefficient : float
        Cd [-].
    oil_density : float
        rho [kg/m3].
    """

    piston_area: float
    supply_pressure: float
    pump_flow: float
    valve_area: float
    discharge_coefficient: float
    oil_density: float
    transition_drop: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def drop(self, flow: Array, area: Array | float) -> Array:
        """Return the pressure drop [Pa] of a flow [m3/s] through an area [m2].

        dp^2 = D (D + sqrt(D^2 + 4 c^2))/2 with the turbulent drop D.
        """
        turbulent = self.oil_density / 2 * (flow / (self.discharge_coefficient * area)) ** 2
        return np.sqrt(turbulent / 2 * (turbulent + np.hypot(turbulent, 2 * self.transition_drop)))

    def area(self, flow: Array, drop: Array) -> Array:
        """Return the area [m2] that passes a flow [m3/s] under a pressure drop > 0 [Pa]."""
        turbulent = np.sqrt(np.hypot(drop, self.transition_drop) * self.oil_density / 2)
        return flow * turbulent / self.discharge_coefficient / drop

    def run(self, cart: Cart, cycle: Cycle, resistance: Resistance, working: tuple[float, float]) -> Run:
        """Solve pressures and areas over a cycle, for `rigid_drive.simulate`."""
        return solved(HydraulicRun(cart, cycle, resistance, working, self))


@dataclass(frozen=True)
class ValveFlow:
    """Flow through the valves and pressures of the driving direction; arrays of one shape.

    Parameters
    ----------
    flow : ndarray
        Q [m3/s].
    inlet_pressure, outlet_pressure : ndarray
        p_in and p_out [Pa].
    inlet_area, outlet_area : ndarray
        Areas of the valves [m2].
    """

    flow: Array
    inlet_pressure: Array
    outlet_pressure: Array
    inlet_area: Array
    outlet_area: Array


def solve_valve_flow(hydraulic: Hydraulic, velocity: Array, force: Array) -> ValveFlow:
    """Solve flow, pressures and valve areas for velocities [m/s] and drive forces along the motion [N].

    Inlet areas are infinite where the required pressure exceeds that of the supply.
    """
    flow = hydraulic.piston_area * np.abs(velocity)
    open_drop = hydraulic.drop(flow, hydraulic.valve_area)
    outlet = np.maximum(open_drop, -force / hydraulic.piston_area)
    inlet = outlet + force / hydraulic.piston_area
    drop = hydraulic.supply_pressure - inlet
    with np.errstate(divide="ignore", invalid="ignore"):
        inlet_area = np.where(drop > 0, hydraulic.area(flow, drop), np.inf)
        outlet_area = np.where(outlet > open_drop, hydraulic.area(flow, outlet), hydraulic.valve_area)
    return ValveFlow(flow, inlet, outlet, inlet_area, outlet_area)


@dataclass(frozen=True)
class HydraulicRun(Run):
    """One cycle of a cart under a law controlled by two valves; the drive is a `Hydraulic`."""

    @cached_property
    def valve_flow(self) -> ValveFlow:
        """Flow, pressures and areas over the cycle, shape (n,)."""
        return solve_valve_flow(self.drive, self.state.velocity, self.direction * self.drive_force)

    @property
    def peak_pressure(self) -> float:
        """Largest pressure of a cylinder [Pa]; read by its name for the summary."""
        return float(max(self.valve_flow.inlet_pressure.max(), self.valve_flow.outlet_pressure.max()))

    @property
    def peak_flow(self) -> float:
        """Largest flow [m3/s]."""
        return float(self.valve_flow.flow.max())

    @property
    def lack(self) -> str:
        """Quantity of the drive that is insufficient for the law; empty for a sufficient drive."""
        if self.impulses:
            return "force: the velocity jumps"
        if self.peak_flow > self.drive.pump_flow:
            return "pump flow"
        if self.valve_flow.inlet_pressure.max() >= self.drive.supply_pressure:
            return "supply pressure"
        return "valve area" if self.valve_flow.inlet_area.max() > self.drive.valve_area else ""

    @property
    def pump_work(self) -> float:
        """Work of the pump over the cycle [J], p_s times its constant flow."""
        return self.drive.supply_pressure * self.drive.pump_flow * self.period

    @property
    def throttle_heat(self) -> float:
        """Heat of both valves over the cycle [J]."""
        valves = self.valve_flow
        drop = self.drive.supply_pressure - valves.inlet_pressure + valves.outlet_pressure
        return self._mean(valves.flow * drop) * self.period

    @property
    def relief_heat(self) -> float:
        """Heat of the relief valve over the cycle [J]."""
        excess = self.drive.pump_flow - self.valve_flow.flow
        return self._mean(self.drive.supply_pressure * excess) * self.period

    @property
    def energy_residual(self) -> float:
        """Energy-balance residual of pump, cart and valves over the work of the pump [-]."""
        return abs(self.pump_work - self.energy - self.throttle_heat - self.relief_heat) / self.pump_work
