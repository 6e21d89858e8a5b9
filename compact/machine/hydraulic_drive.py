"""The hydraulic drive: two cylinders move the cart, one each way, and two throttles make the law.

    H = A (p_in - p_out),   Q = A |v|,   Q = Cd a sqrt(2/rho) dp/(dp^2 + c^2)^(1/4)

A pump of constant flow with a relief valve at p_s feeds the cylinder that drives through one throttle, dp = p_s - p_in;
the other cylinder empties into the tank through the other one, dp = p_out; below c the flow is laminar. Asked for is
the inverse: of a law that is followed, pressures, flow and the areas a over time that make it. The outlet stays wide
open until the cart has to be held back; then p_in is no more than it must. Forward (`passage`) areas are given and the
oil yields,

    (V/K) p_in' = Q_in - A v,   (V/K) p_out' = A v - Q_out,   m v' = A (p_in - p_out) - W(v) - guides + end springs,

V the volume of a cylinder and its line, K the bulk modulus. W may follow the acceleration, F(v) + v' M(v), which makes
the cart as much heavier; it may hold the cart, which then stands until the pressures get over it. Leakage, inertia of
oil and changes of Cd are left out.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from itertools import count, pairwise

import numpy as np
from scipy.integrate import solve_ivp

from compact.machine.cart import Cart, balance
from compact.machine.rigid_drive import CREEP, Rigid, Run, evaluate_resistance, simulate
from compact.numerics.piecewise import PiecewisePolynomial, fit_piecewise
from compact.numerics.validation import require_opposing, require_positive

NEAR = 1e-6  # of the open area, by which polynomials may miss that of a throttle
RTOL = 1e-8  # of the forward motion
PROBE = 1e-7  # difference for derivatives, over the scale of the state
SECANTS, BALANCED = 20, 1e-12  # of the balance at an instant; left over, of the force
MOST_EVALUATIONS = 1_000_000  # [-], of the rates over a passage: about a minute; 1e4 are usual
TURNS = 200  # standing and moving in turn, within a piece
ENERGIES = ("pump", "relief", "inlet_heat", "outlet_heat", "compression", "resistance_work")


@dataclass(frozen=True)
class Hydraulic(Rigid):
    """A hydraulic drive.

    piston_area : A [m2];  supply_pressure : p_s of the relief valve [Pa];  pump_flow : [m3/s]
    valve_area : of a throttle wide open [m2];  discharge_coefficient : Cd;  oil_density : rho [kg/m3]
    transition_drop : c [Pa];  bulk_modulus : K [Pa]
    dead_volume : of a cylinder with its line, the piston at its end [m3]
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

    def __post_init__(self):
        require_positive(**{field.name: getattr(self, field.name) for field in fields(self)})

    def flow(self, area, drop):
        """Q [m3/s] through an area [m2] under a drop of pressure [Pa], either way."""
        return area * drop / self._slowness(drop)

    def open_drop(self, flow):
        """Drop of pressure [Pa] of a flow through a throttle wide open."""
        return self.drop(flow, self.valve_area)

    def drop(self, flow, area):
        """Drop of pressure [Pa] of a flow through an area [m2]: dp^2 = D (D + sqrt(D^2 + 4 c^2))/2, D at c = 0."""
        turbulent = self.oil_density / 2 * (flow / (self.discharge_coefficient * area)) ** 2
        return np.sqrt(turbulent / 2 * (turbulent + np.hypot(turbulent, 2 * self.transition_drop)))

    def area(self, flow, drop):
        """Area [m2] that lets a flow through under a drop of pressure > 0."""
        return flow * self._slowness(drop) / drop

    def _slowness(self, drop):
        return np.sqrt(np.hypot(drop, self.transition_drop) * self.oil_density / 2) / self.discharge_coefficient

    def run(self, cart, cycle, resistance, working):
        """The `HydraulicRun`: what `rigid_drive.simulate` asks of a drive."""
        run = simulate(cart, Rigid(), cycle, resistance, working=working)
        return HydraulicRun(**{field.name: getattr(run, field.name) for field in fields(run)}, hydraulic=self)


@dataclass(frozen=True)
class Throttled:
    """What makes a law: flow [m3/s], pressures [Pa] in and behind the cylinder that drives, areas [m2] of throttles."""

    flow: np.ndarray
    inlet_pressure: np.ndarray
    outlet_pressure: np.ndarray
    inlet_area: np.ndarray
    outlet_area: np.ndarray


def throttled(hydraulic, velocity, force):
    """`Throttled` of a cart that is driven forwards at velocities [m/s] by forces [N], + along the travel.

    Areas are infinite where the supply has no more pressure than is needed.
    """
    flow = hydraulic.piston_area * np.abs(velocity)
    free = hydraulic.open_drop(flow)
    outlet = np.maximum(free, -force / hydraulic.piston_area)
    inlet = outlet + force / hydraulic.piston_area
    drop = hydraulic.supply_pressure - inlet
    with np.errstate(divide="ignore", invalid="ignore"):
        narrow = np.where(drop > 0, hydraulic.area(flow, drop), np.inf)
        held = np.where(outlet > free, hydraulic.area(flow, outlet), hydraulic.valve_area)
    return Throttled(flow, inlet, outlet, narrow, held)


@dataclass(frozen=True)
class HydraulicRun(Run):
    """One cycle of a cart whose law two throttles make."""

    hydraulic: Hydraulic

    @cached_property
    def throttled(self):
        """`Throttled` over the cycle, arrays of shape (n,)."""
        return throttled(self.hydraulic, self.state.velocity, self.direction * self.drive_force)

    @property
    def peak_pressure(self):
        """Largest pressure of a cylinder [Pa]."""
        return float(max(self.throttled.inlet_pressure.max(), self.throttled.outlet_pressure.max()))

    @property
    def peak_flow(self):
        """Largest flow [m3/s]."""
        return float(self.throttled.flow.max())

    @property
    def lack(self):
        """What the drive has too little of for the law; empty where it has enough."""
        if self.impulses:
            return "force: the velocity jumps"
        if self.peak_flow > self.hydraulic.pump_flow:
            return "pump flow"
        if self.throttled.inlet_pressure.max() >= self.hydraulic.supply_pressure:
            return "supply pressure"
        return "valve area" if self.throttled.inlet_area.max() > self.hydraulic.valve_area else ""

    @property
    def pump_work(self):
        """p_s times the pump's flow over the cycle [J]: the relief valve takes what the cart does not."""
        return self.hydraulic.supply_pressure * self.hydraulic.pump_flow * self.period

    @property
    def throttle_heat(self):
        """What both throttles turn into heat over the cycle [J]."""
        made = self.throttled
        drop = self.hydraulic.supply_pressure - made.inlet_pressure + made.outlet_pressure
        return self._mean(made.flow * drop) * self.period

    @property
    def relief_heat(self):
        """What the relief valve turns into heat over the cycle [J]."""
        spare = self.hydraulic.pump_flow - self.throttled.flow
        return self._mean(self.hydraulic.supply_pressure * spare) * self.period

    @property
    def energy_residual(self):
        """|pump's work - work on the cart - heat of throttles and relief valve| over the pump's work."""
        return abs(self.pump_work - self.energy - self.throttle_heat - self.relief_heat) / self.pump_work

    def areas(self):
        """(inlet, outlet) area [m2] over the time of the way there [s], `PiecewisePolynomial`.

        Raises RuntimeError where the drive has too little of something.
        """
        if self.lack:
            raise RuntimeError(f"no throttles make '{self.name}': the drive has too little {self.lack}; give more")
        leg = self.demand.cycle.legs()[0]

        def area(name):
            def over(time):
                state = self.demand.at(leg, time / leg.duration)
                return getattr(throttled(self.hydraulic, state.velocity, state.forces.drive_force), name)

            return fit_piecewise(over, leg.duration * self.demand.breaks(leg), NEAR * self.hydraulic.valve_area)

        return area("inlet_area"), area("outlet_area")

    def forward(self):
        """The `Passage` there under these throttles, with oil that yields, from the law's first pressures on."""
        start = self.throttled
        pressures = float(start.inlet_pressure[0]), float(start.outlet_pressure[0])
        stroke = self.demand.cycle.forward.stroke
        return passage(self.demand.cart, self.hydraulic, stroke, self.areas(), self.demand.resistance, pressures)


@dataclass(frozen=True)
class Passage:
    """A cart driven by throttles; arrays of shape (n,), and what became of the pump's work [J].

    residual : of the balance of work, over the pump's work
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    inlet_pressure: np.ndarray
    outlet_pressure: np.ndarray
    energies: dict
    residual: float


def passage(cart, hydraulic, stroke, areas, resistance, pressures=(0.0, 0.0), *, rtol=RTOL):
    """The `Passage` of a cart from rest at the near end, under given throttles.

    Parameters
    ----------
    cart : Cart, mass > 0;  hydraulic : Hydraulic;  stroke : [m], of the cylinders
    areas : (inlet, outlet) [m2] over time [s], `PiecewisePolynomial`; the motion lasts as long as they do
    resistance : callable(velocity, acceleration) -> N, in m a + resistance rising with the acceleration
    pressures : (inlet, outlet) to begin with [Pa]

    Raises ValueError for a resistance that does not oppose the motion, and RuntimeError where the motion cannot be
    followed.
    """
    require_positive(mass=cart.mass, stroke=stroke, rtol=rtol)
    require_opposing(resistance, stroke / max(float(area.breaks[-1] - area.breaks[0]) for area in areas))
    plant = _Plant(cart, hydraulic, stroke, areas, resistance)
    breaks = np.unique(np.concatenate([areas[0].breaks, areas[1].breaks]))
    breaks = breaks[np.append(True, np.diff(breaks) > 1e-9 * breaks[-1])]
    state, way = np.array([0.0, 0.0, *pressures] + [0.0] * len(ENERGIES)), 0
    columns = []
    for start, end in pairwise(breaks):
        state, way = plant.through(start, end, state, way, rtol, columns)
    time, states = (np.concatenate(each, axis=-1) for each in zip(*columns, strict=True))
    energies = dict(zip(ENERGIES, states[4:, -1].tolist(), strict=True))
    kinetic, springs = cart.mass / 2 * state[1] ** 2, plant.held(state[0]) - plant.held(0.0)
    energies |= {"kinetic": float(kinetic), "springs": float(springs)}
    left = energies["pump"] - sum(work for name, work in energies.items() if name != "pump")
    return Passage(time, *states[:4], energies, abs(left) / energies["pump"])


@dataclass(frozen=True)
class _Plant:
    """Cylinders, throttles and cart; its state is x, v, p_in, p_out and the ENERGIES."""

    cart: Cart
    hydraulic: Hydraulic
    stroke: float
    areas: tuple[PiecewisePolynomial, PiecewisePolynomial]
    resistance: Callable
    evaluations: Iterator = field(default_factory=count)

    def through(self, time, end, state, way, rtol, columns):
        """State and way (+1, -1, 0 standing) at the end of a piece, standing and moving in turn."""
        supply = self.hydraulic.supply_pressure
        turned = supply * self.hydraulic.piston_area * self.stroke
        scale = np.array([self.stroke, self.stroke / end, supply, supply] + [turned] * len(ENERGIES))
        for _ in range(TURNS):
            way = way or self._freed(state)
            got = solve_ivp(
                partial(self._rates, way=way), (time, end), state, "Radau", events=self._events(way), rtol=rtol,
                atol=rtol * scale, jac=partial(self._slopes, way=way, scale=scale),
            )  # fmt: skip
            if got.status < 0:
                break
            columns.append((got.t, got.y))
            time, state = got.t[-1], got.y[:, -1].copy()
            if got.status == 0:
                return state, way
            state[1] = 0.0
            way = 0 if way else 1 if got.t_events[0].size else -1
        raise RuntimeError(
            f"the cart was followed to {time:g} s of {end:g} s and no further; it stops and starts for ever"
        )

    def held(self, position):
        """Energy of the end springs [J]."""
        return 0.0 if self.cart.end_springs is None else float(self.cart.end_springs.energy(position))

    def _rates(self, time, state, way):
        if next(self.evaluations) > MOST_EVALUATIONS:
            raise RuntimeError(
                f"the cart was followed to {time:g} s in {MOST_EVALUATIONS} evaluations and no further: the oil rings "
                "too fast for its time; give a smaller bulk modulus or a larger dead volume"
            )
        plant, (x, velocity, inlet, outlet) = self.hydraulic, state[:4]
        open_in, open_out = (max(float(area(time)), 0.0) for area in self.areas)
        filled, line = plant.flow(open_in, plant.supply_pressure - inlet), plant.supply_pressure
        if filled > plant.pump_flow:  # the pump gives no more, and the pressure before the throttle falls
            filled, line = plant.pump_flow, inlet + plant.drop(plant.pump_flow, open_in)
        emptied = plant.flow(open_out, outlet)
        swept = plant.piston_area * velocity if way else 0.0
        squeezed = np.array([filled - swept, swept - emptied])
        volume = plant.dead_volume + plant.piston_area * np.array([x, self.stroke - x])
        force = plant.piston_area * (inlet - outlet)
        acceleration = self._accelerated(x, velocity, way, force) if way else 0.0
        resisted = force - self.cart.mass * acceleration
        return np.array([
            velocity if way else 0.0, acceleration,
            *(plant.bulk_modulus / volume * squeezed), line * plant.pump_flow, line * (plant.pump_flow - filled),
            (line - inlet) * filled, outlet * emptied, squeezed @ [inlet, outlet],
            (resisted + self._push(x)) * velocity if way else 0.0,
        ])  # fmt: skip

    def _slopes(self, time, state, way, scale):
        """Derivatives of the rates by the state; of what has become of the work nothing depends."""
        slopes, now = np.zeros((len(state), len(state))), self._rates(time, state, way)
        for k in range(4):
            probe = state.copy()
            probe[k] += PROBE * scale[k]
            slopes[:, k] = (self._rates(time, probe, way) - now) / (PROBE * scale[k])
        return slopes

    def _accelerated(self, position, velocity, way, force):
        """The acceleration that balances a force [N], by secants: two where the resistance is linear in it.

        Raises RuntimeError where there is none, as where a lag of the mix outweighs the cart.
        """
        tried, left = 0.0, force - self._resisted(position, velocity, way)
        next_one = left / self.cart.mass
        for _ in range(SECANTS):
            before, tried = tried, next_one
            last, left = left, force - self._resisted(position, velocity, way, tried) - self.cart.mass * tried
            if abs(left) <= BALANCED * (abs(force) + abs(last)):
                return tried
            next_one = tried - left * (tried - before) / (left - last)
        raise RuntimeError(
            f"no acceleration balances {force:g} N at {velocity:g} m/s, {left:g} N are left at {tried:g} m/s^2; "
            "does the resistance fall with the acceleration by more than the cart's mass?"
        )

    def _resisted(self, position, velocity, way, acceleration=0.0):
        """W + guides - end springs [N] of a cart that goes one way."""
        moving = np.array([way * max(way * velocity, CREEP)])
        met = evaluate_resistance(self.resistance, moving, np.array([acceleration]))
        return float(balance(self.cart, 0.0, met, way, push=self._push(position)).drive_force[0])

    def _push(self, position):
        springs = self.cart.end_springs
        if springs is None:
            return 0.0
        side = float(position < springs.length) - float(position > springs.stroke - springs.length)
        return float(springs.push(position, side))

    def _spare(self, time, state, way):
        """What is left of the friction that holds a standing cart from going a way [N]."""
        pull = self.hydraulic.piston_area * (state[2] - state[3])
        return way * (self._resisted(state[0], 0.0, way) - pull)

    def _freed(self, state):
        return next((way for way in (1, -1) if self._spare(0.0, state, way) < 0), 0)

    def _events(self, way):
        """What ends a stretch: the cart stops, or the pressures get over its friction."""

        def stops(time, state):
            return way * state[1]

        events = [stops] if way else [partial(self._spare, way=1), partial(self._spare, way=-1)]
        for event in events:
            event.terminal, event.direction = True, -1
        return events
