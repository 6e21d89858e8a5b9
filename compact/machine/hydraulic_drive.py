"""Hydraulic drive: two cylinders move the cart, one in each direction, and two throttle valves control its motion.

    H = A (p_in - p_out),   Q = A |v|,   Q = Cd a sqrt(2/rho) dp/(dp^2 + c^2)^(1/4)

A pump of constant flow with a relief valve at p_s feeds the driving cylinder through the inlet valve, dp = p_s - p_in.
The other cylinder discharges to the tank through the outlet valve, dp = p_out. Below the transition pressure drop c the
flow is laminar.

The inverse problem determines pressures, flow and valve areas a over time for an imposed law. The outlet valve is
fully open until the cart must be decelerated, so that p_in is as low as possible. The forward problem
(`Circuit.simulate`) determines the motion for imposed valve areas and a compressible oil:

    (V/K) p_in' = Q_in - A v,   (V/K) p_out' = A v - Q_out,   m v' = A (p_in - p_out) - W(v) - guides + end springs

V is the volume of a cylinder with its line, K the bulk modulus. W may depend on the acceleration, F(v) + v' M(v), which
adds to the mass of the cart. It may hold the cart at rest until the pressures exceed its limit. Leakage, inertia of the
oil and variation of Cd are neglected.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import count, pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from compact.machine.cart import Cart, Resistance, balance
from compact.machine.rigid_drive import (
    SLOW_SPEED_RATIO,
    STANDSTILL_SPEED_RATIO,
    Rigid,
    Run,
    evaluate_resistance,
    solved,
    stroke_shares,
)
from compact.motion.profile import Cycle
from compact.numerics import Array
from compact.numerics.piecewise import PiecewisePolynomial, fit_piecewise, interior_grid
from compact.numerics.validation import require_opposing, require_positive
from compact.turning import StrokeShares

AREA_TOLERANCE = 1e-6  # [-], of the open area; polynomials of a valve area
FORCE_ROUNDING = 1e-9  # [-], of the peak force; the areas of smaller forces at the ends of a stroke are rounding
STROKE_TOLERANCE = 1e-8  # [-], relative; forward integration
RATE_PERTURBATION = 1e-7  # [-], of the scale of the state; finite differences
MAX_SECANT_STEPS = 20  # [-], of the acceleration at an instant; two for a resistance that is linear in it
FORCE_TOLERANCE = 1e-12  # [-], of the forces; residual of the acceleration at an instant
MAX_EVALUATIONS = 1_000_000  # [-], of the rates over a stroke, about a minute; 1e4 are usual
MAX_STOPS = 200  # [-], alternations of motion and rest within a piece of the valve areas
MIN_PIECE_FRACTION = 1e-9  # [-], of the duration; closer breaks of the valve areas coincide
WORK_TERMS = ("pump", "relief", "inlet_heat", "outlet_heat", "compression", "resistance_work")

ValveAreas = tuple[PiecewisePolynomial, PiecewisePolynomial]


@dataclass(frozen=True)
class Hydraulic(Rigid):
    """Pump, relief valve, cylinders and throttle valves.

    Parameters
    ----------
    piston_area, valve_area : float
        A, and area of a fully open throttle valve [m2].
    supply_pressure, transition_drop, bulk_modulus : float
        p_s of the relief valve, pressure drop c at the transition to turbulent flow, and K [Pa].
    pump_flow : float
        [m3/s].
    discharge_coefficient : float
        Cd [-].
    oil_density : float
        rho [kg/m3].
    dead_volume : float
        Volume of a cylinder and its line with the piston at its end [m3].
    """

    piston_area: float
    supply_pressure: float
    pump_flow: float
    valve_area: float
    discharge_coefficient: float
    oil_density: float
    transition_drop: float
    bulk_modulus: float
    dead_volume: float

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def flow(self, area: Array, drop: Array) -> Array:
        """Return Q [m3/s] through an area [m2] under a pressure drop of either sign [Pa]."""
        return area * drop / self._flow_resistance(drop)

    def drop(self, flow: Array, area: Array | float) -> Array:
        """Return the pressure drop [Pa] of a flow [m3/s] through an area [m2].

        dp^2 = D (D + sqrt(D^2 + 4 c^2))/2 with the turbulent drop D.
        """
        turbulent = self.oil_density / 2 * (flow / (self.discharge_coefficient * area)) ** 2
        return np.sqrt(turbulent / 2 * (turbulent + np.hypot(turbulent, 2 * self.transition_drop)))

    def area(self, flow: Array, drop: Array) -> Array:
        """Return the area [m2] that passes a flow [m3/s] under a pressure drop > 0 [Pa]."""
        return flow * self._flow_resistance(drop) / drop

    def _flow_resistance(self, drop):
        """Pressure drop over flow per area [Pa s/m]."""
        return np.sqrt(np.hypot(drop, self.transition_drop) * self.oil_density / 2) / self.discharge_coefficient

    def run(self, cart: Cart, cycle: Cycle, resistance: Resistance, working: tuple[float, float]) -> Run:
        """Solve the inverse problem over a cycle, for `rigid_drive.simulate`."""
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

    def valve_areas(self) -> ValveAreas:
        """Compute inlet and outlet area [m2] over time [s] of the forward stroke; RuntimeError for a weak drive."""
        if self.lack:
            raise RuntimeError(
                f"the drive cannot follow '{self.name}': insufficient {self.lack}; use a stronger drive or another law"
            )
        dynamics = self.inverse_dynamics
        leg = dynamics.cycle.legs()[0]
        breaks, (first, last) = dynamics.breaks(leg), self._resolved_phases(leg)

        def area(name: str) -> PiecewisePolynomial:
            def over_time(time: Array) -> Array:
                state = dynamics.state_at(leg, np.clip(time / leg.duration, first, last))
                return getattr(solve_valve_flow(self.drive, state.velocity, state.forces.drive_force), name)

            return fit_piecewise(over_time, leg.duration * breaks, AREA_TOLERANCE * self.drive.valve_area)

        return area("inlet_area"), area("outlet_area")

    def _resolved_phases(self, leg):
        """First and last phase of a leg at which the force is not rounding; areas at rest are limits from inside.

        Where neither friction nor resistance acts, force and flow both vanish at the ends, and rounding decides
        whether the cart is decelerated, which opens or closes the outlet valve.
        """
        phases = interior_grid(self.inverse_dynamics.breaks(leg)).ravel()
        force = np.abs(self.inverse_dynamics.state_at(leg, phases).forces.drive_force)
        first, last = np.flatnonzero(force >= FORCE_ROUNDING * force.max())[[0, -1]]
        return phases[first] if first else 0.0, phases[last] if last < len(phases) - 1 else 1.0

    def simulate_stroke(self, rtol: float = STROKE_TOLERANCE) -> "HydraulicStroke":
        """Simulate the forward stroke under these valve areas with compressible oil, from the initial pressures."""
        dynamics, valves = self.inverse_dynamics, self.valve_flow
        pressures = float(valves.inlet_pressure[0]), float(valves.outlet_pressure[0])
        stroke, areas = dynamics.cycle.forward.stroke, self.valve_areas()
        return Circuit(dynamics.cart, self.drive, stroke, areas, dynamics.resistance).simulate(pressures, rtol)


@dataclass(frozen=True)
class HydraulicStroke:
    """Motion of a cart under given valve areas; arrays of shape (n,).

    Parameters
    ----------
    time : ndarray
        [s].
    position, velocity : ndarray
        [m], [m/s].
    inlet_pressure, outlet_pressure : ndarray
        [Pa].
    energies : dict
        Terms of the energy balance [J]: work of the pump, heat, compression of the oil, work on the resistance, and
        the gains of kinetic and spring energy.
    energy_residual : float
        Energy-balance residual over the work of the pump [-].
    """

    time: Array
    position: Array
    velocity: Array
    inlet_pressure: Array
    outlet_pressure: Array
    energies: dict[str, float]
    energy_residual: float


@dataclass(frozen=True)
class Circuit:
    """Cylinders, valves and cart; the state is x, v, p_in, p_out and the `WORK_TERMS`.

    Parameters
    ----------
    cart : Cart
        Cart of mass > 0.
    hydraulic : Hydraulic
        Drive.
    stroke : float
        Stroke of the cylinders [m].
    areas : tuple of PiecewisePolynomial
        Inlet and outlet area [m2] over time [s]; their range is that of the simulation.
    resistance : callable
        Force of the mix [N] of velocity [m/s] and acceleration [m/s^2]; m a + resistance increases with a.
    """

    cart: Cart
    hydraulic: Any
    stroke: float
    areas: Any
    resistance: Resistance
    evaluations: Iterator[int] = field(default_factory=count)

    def simulate(self, pressures: tuple[float, float] = (0.0, 0.0), rtol: float = STROKE_TOLERANCE) -> HydraulicStroke:
        """Simulate the cart from rest at the near end, with initial pressures of inlet and outlet [Pa].

        Raises
        ------
        RuntimeError
            If the integration ends early.
        """
        cart, stroke = self.cart, self.stroke
        require_positive(mass=cart.mass, stroke=stroke, rtol=rtol)
        require_opposing(self.resistance, stroke / max(float(area.breaks[-1] - area.breaks[0]) for area in self.areas))
        breaks = np.unique(np.concatenate([area.breaks for area in self.areas]))
        breaks = breaks[np.append(True, np.diff(breaks) > MIN_PIECE_FRACTION * breaks[-1])]
        supply = self.hydraulic.supply_pressure
        work = supply * self.hydraulic.piston_area * stroke
        state, direction, parts = np.array([0.0, 0.0, *pressures] + [0.0] * len(WORK_TERMS)), 0, []
        for start, end in pairwise(breaks):
            scale, time = np.array([stroke, stroke / end, supply, supply] + [work] * len(WORK_TERMS)), start
            for _ in range(MAX_STOPS):  # alternating motion and rest
                breakaways = (way for way in (1, -1) if self.stiction_margin(0.0, state, way) < 0)
                direction = direction or next(breakaways, 0)
                solution = solve_ivp(
                    partial(self.rates, direction=direction), (time, end), state, "Radau", rtol=rtol, atol=rtol * scale,
                    events=self.events(direction), jac=partial(self.jacobian, direction=direction, scale=scale),
                )  # fmt: skip
                parts.append(solution)
                time, state = solution.t[-1], solution.y[:, -1].copy()
                if solution.status != 1:
                    break
                state[1] = 0.0
                direction = 0 if direction else 1 if solution.t_events[0].size else -1
            if solution.status != 0:
                raise RuntimeError(
                    f"the integration of the cart ended at {time:.3g} s of {end:.3g} s: it alternates between motion "
                    "and rest; use stiffer oil (a larger `bulk_modulus`, a smaller `dead_volume`), or check "
                    "`resistance` near rest"
                )
        times, states = np.concatenate([part.t for part in parts]), np.concatenate([part.y for part in parts], axis=1)
        springs = 0.0 if cart.end_springs is None else float(np.diff(cart.end_springs.energy([0.0, state[0]]))[0])
        energies = dict(zip(WORK_TERMS, state[4:].tolist(), strict=True))
        energies["resistance_work"] -= springs  # the force on the cart contains that of the springs
        energies |= {"kinetic": float(cart.mass / 2 * state[1] ** 2), "springs": springs}
        residual = 2 * energies["pump"] - sum(energies.values())
        position, velocity, inlet, outlet = states[:4]
        return HydraulicStroke(times, position, velocity, inlet, outlet, energies, abs(residual) / energies["pump"])

    def rates(self, time: float, state: Array, direction: int) -> Array:
        """Time derivative of the state; the pressure before the inlet valve falls at the full pump flow."""
        if next(self.evaluations) > MAX_EVALUATIONS:
            raise RuntimeError(
                f"the integration of the cart ended at {time:g} s after {MAX_EVALUATIONS} evaluations: the oil "
                "oscillates too fast; use a smaller `bulk_modulus` or a larger `dead_volume`"
            )
        drive, (x, velocity, inlet, outlet) = self.hydraulic, state[:4]
        inlet_area, outlet_area = (max(float(area(time)), 0.0) for area in self.areas)
        line_pressure, inflow = drive.supply_pressure, drive.flow(inlet_area, drive.supply_pressure - inlet)
        if inflow > drive.pump_flow:
            inflow, line_pressure = drive.pump_flow, inlet + drive.drop(drive.pump_flow, inlet_area)
        outflow = drive.flow(outlet_area, outlet)
        velocity = velocity if direction else 0.0
        piston_flow, force = drive.piston_area * velocity, drive.piston_area * (inlet - outlet)
        compression = np.array([inflow - piston_flow, piston_flow - outflow])
        volume = drive.dead_volume + drive.piston_area * np.array([x, self.stroke - x])
        acceleration = self._solve_acceleration(x, velocity, direction, force) if direction else 0.0
        return np.array([
            velocity, acceleration, *(drive.bulk_modulus / volume * compression),
            line_pressure * drive.pump_flow, line_pressure * (drive.pump_flow - inflow),
            (line_pressure - inlet) * inflow, outlet * outflow, compression @ [inlet, outlet],
            (force - self.cart.mass * acceleration) * velocity,
        ])  # fmt: skip

    def jacobian(self, time: float, state: Array, direction: int, scale: Array) -> Array:
        """Differentiate the rates with respect to the state; they do not depend on the work terms."""
        jacobian, here = np.zeros((len(state), len(state))), self.rates(time, state, direction)
        for k in range(4):
            perturbed = state.copy()
            perturbed[k] += RATE_PERTURBATION * scale[k]
            jacobian[:, k] = (self.rates(time, perturbed, direction) - here) / (RATE_PERTURBATION * scale[k])
        return jacobian

    def _solve_acceleration(self, position, velocity, direction, force):
        """Acceleration [m/s^2] in balance with a drive force [N], by the secant method."""
        a, residual = 0.0, force - self._resisting_force(position, velocity, direction)
        next_a = residual / self.cart.mass
        for _ in range(MAX_SECANT_STEPS):
            before, a, last = a, next_a, residual
            residual = force - self._resisting_force(position, velocity, direction, a) - self.cart.mass * a
            if abs(residual) <= FORCE_TOLERANCE * (abs(force) + abs(last)):
                return a
            next_a = a - residual * (a - before) / (residual - last)
        raise RuntimeError(
            f"no acceleration balances a drive force of {force:g} N at {velocity:g} m/s, residual {residual:g} N at "
            f"{a:g} m/s^2; use a resistance that falls with the acceleration by less than the mass of the cart"
        )

    def _resisting_force(self, position, velocity, direction, acceleration=0.0):
        """Return the force W + guides - end springs [N] for a direction of motion."""
        moving = np.array([direction * max(direction * velocity, STANDSTILL_SPEED_RATIO)])
        resistance = evaluate_resistance(self.resistance, moving, np.array([acceleration]))
        springs, end_force, load = self.cart.end_springs, 0.0, 1.0
        if self.shares is not None:
            share, load = self._shares_at(position, direction)
            resistance = resistance * share
        if springs is not None:
            side = float(position < springs.length) - float(position > springs.stroke - springs.length)
            end_force = float(springs.force(position, side))
        forces = balance(self.cart, 0.0, resistance, direction, end_spring_force=end_force, load_share=load)
        return float(forces.drive_force[0])

    @cached_property
    def shares(self) -> tuple[StrokeShares, StrokeShares] | None:
        """Shares of force and load over both strokes."""
        duration = max(float(area.breaks[-1]) for area in self.areas)
        return stroke_shares(self.cart, self.stroke, duration, self.resistance)

    def _shares_at(self, position, direction):
        """Shares of force and load [-] at a position [m]; a cart that moves back unloads the mix as a spring."""
        shares = self.shares[0]
        share, load = float(shares.force_share(max(position, 0.0))), float(shares.load_share(max(position, 0.0)))
        if direction > 0:
            return share, load
        if not shares.force.release:
            return float(self.shares[1].force(0.0)), load
        return -share / self.resistance.force_ratio(SLOW_SPEED_RATIO), load / (self.cart.return_load_ratio or 1.0)

    def stiction_margin(self, _time: float, state: Array, direction: int) -> float:
        """Force that is missing to a breakaway in a direction [N]."""
        force = self.hydraulic.piston_area * (state[2] - state[3])
        return direction * (self._resisting_force(state[0], 0.0, direction) - force)

    def events(self, direction: int) -> list[Callable[..., float]]:
        """Stop of a moving cart, or breakaway of a cart at rest."""
        margins = [partial(self.stiction_margin, direction=way) for way in (1, -1)]
        events: list[Any] = [lambda _time, state: direction * state[1]] if direction else margins
        for event in events:
            event.terminal, event.direction = True, -1
        return events
