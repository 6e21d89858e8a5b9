"""One motion law on many elastic drives: the drive force of each in the periodic regime (`spring_pass`).

The peak force is within 1e-3 of `simulate_elastic` at `STEPS` steps. A simulation from the states of a similar law
takes half a millisecond, a twentieth of that of `simulate_elastic`, which tabulates law and resistance anew for each
drive and divides a pass at each place at which a share is not smooth, for forces exact to 1e-8.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import parent_process
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.analysis.robust.spring_pass import (
    BACK_FRONT,
    BACK_ORIGIN,
    DISTANCE,
    ELONGATION,
    FRONT,
    HEADING,
    SIZE,
    UNKNOWNS,
    PassTable,
    TravelTable,
    simulate_all,
)
from compact.analysis.worker_pool import cores
from compact.machine.cart import Cart, Resistance
from compact.machine.elastic_motion import guide_wheels
from compact.machine.rigid_drive import evaluate_resistance
from compact.motion.profile import MotionProfile
from compact.numerics import Array
from compact.turning import StrokeResistance

STEPS = 720  # [-], of a pass; twice as many change no peak force of a periodic regime by 1e-3
SHARE_SAMPLES = 4096  # [-], of the share over the stroke
SPEED_SAMPLES = 512  # [-], of the steady force over the speeds
SPEED_RANGE = 3.0  # [-], largest tabulated speed of the cart over that of the law; held beyond
SLOWEST = 1e-6  # [-], slowest tabulated speed over the fastest
THREAD_DRIVES = 4  # [-], that a thread simulates at a time; those without periodic regime take ten times as long
MIRRORED = 1e-9  # [-], difference of both strokes that is rounding


def travel_table(cart: Cart, resistance: Resistance, stroke: float, fastest: float) -> TravelTable:
    """Tabulate a resistance over travels up to the stroke [m] and speeds up to `SPEED_RANGE` times the fastest [m/s].

    Beyond the sampled speeds of a map its force is held. One that is no `StrokeResistance` is a step at the turn. Both
    strokes may differ in share, distance and guides.
    """
    known: Sequence[float] = getattr(resistance, "speeds", ())
    largest = min(SPEED_RANGE * fastest, known[-1] if len(known) else np.inf)
    speeds = largest * np.linspace(0, 1, SPEED_SAMPLES + 1) ** 2
    forces = evaluate_resistance(resistance, np.maximum(speeds, SLOWEST * speeds[-1]), np.zeros(len(speeds)))
    travels = stroke * np.linspace(0, 1, SHARE_SAMPLES + 1)
    wheels = guide_wheels(cart, float(np.abs(forces).max()) or 1.0)
    wheels[1] = wheels[1, ::-1] * np.array([1, 1, -1])  # of the mirror image
    shares = loads = np.ones((2, len(travels)))
    turns = np.tile([1.0, 0.0, 0.0, 1.0], (2, 1))
    if isinstance(resistance, StrokeResistance):
        sides = (resistance.forward, resistance.forward_load), (resistance.backward, resistance.backward_load)
        shares, loads = np.array([[share(travels) for share in side] for side in sides]).swapaxes(0, 1)
        turns = np.array([(force.track, force.distance, force.release, load.track) for force, load in sides])
    numbers = np.column_stack([np.tile([speeds[-1], travels[1]], (2, 1)), turns, wheels.reshape(2, -1)])
    both = [shares, loads, numbers / np.maximum(np.abs(numbers).max(axis=0), 1.0)]
    mirrored = max(np.abs(each[1] - each[0]).max() for each in both) < MIRRORED
    rows = [0, 0, 0] if mirrored else [0, 1, 0]
    return TravelTable(forces, shares[rows], loads[rows], numbers[rows])


def pass_table(law: MotionProfile) -> PassTable:
    """Tabulate a law of which the return stroke is the mirror image."""
    phases = np.linspace(0, 1, STEPS + 1)
    inner = np.array([np.nextafter(phases[:-1], 2.0), np.nextafter(phases[1:], -1.0)])
    starts, ends = law.at_phase(inner, 2)
    return PassTable(law.at_phase(phases, 0), law.at_phase(phases, 1), starts, ends, law.duration / STEPS, law.stroke)


class PoolForces(NamedTuple):
    """Drive forces of one law on the drives of a pool.

    Parameters
    ----------
    forces : ndarray, shape (drives, sides (n + 1))
        H [N] at the instants of a `PassTable`, of a pass that starts in the middle of the forward stroke; where strokes
        differ also, as of the mirror image, of the pass that starts in the middle of the return stroke.
    states : ndarray, shape (drives, SIZE)
        States there; a start for a similar law.
    passes : ndarray, shape (drives,)
        Simulated passes, or pairs of them, 0 where none is periodic.
    """

    forces: Array
    states: Array
    passes: Array

    @property
    def peaks(self) -> Array:
        """Peak force of each drive [N]."""
        return np.abs(self.forces).max(axis=1)

    def powers(self, law: PassTable) -> Array:
        """Drive power H y' [W], of the shape of the forces."""
        velocity = from_the_middle(law.velocity)
        return np.asarray(self.forces * np.tile(velocity, self.forces.shape[1] // len(velocity)))


def from_the_middle(values: Array) -> Array:
    """Return n + 1 values of a pass as of a pass that starts in its middle; on the return stroke they are opposite."""
    middle = len(values) // 2
    return np.concatenate([values[middle:], -values[1 : middle + 1]])


class DrivePool(NamedTuple):
    """Elastic drives of a cart, each with a resistance.

    Parameters
    ----------
    mass : float
        m [kg].
    drives : ndarray, shape (drives, 3)
        k [N/m], damping ratio [-] and index of the resistance.
    tables : tuple of TravelTable
        Resistances.
    """

    mass: float
    drives: Array
    tables: tuple[TravelTable, ...]

    @classmethod
    def of(
        cls, mass: float, springs: Array, tables: tuple[TravelTable, ...], which: Sequence[int] = (0,)
    ) -> "DrivePool":
        """Return every spring (k, damping ratio), shape (springs, 2), with every resistance of some indices."""
        drives = [np.column_stack([springs, np.full(len(springs), i)]) for i in which]
        return cls(mass, np.concatenate(drives), tables)

    def take(self, which: ArrayLike) -> "DrivePool":
        """Return the pool of some drives, by their positions."""
        return self._replace(drives=self.drives[np.asarray(which, int)])

    def joined(self, others: "DrivePool") -> "DrivePool":
        """Return the pool of these drives and others with the same resistances."""
        return self._replace(drives=np.concatenate([self.drives, others.drives]))

    @property
    def damping(self) -> Array:
        """Damping c of each drive [N s/m]."""
        return np.asarray(2 * self.drives[:, 1] * np.sqrt(self.drives[:, 0] * self.mass))

    @property
    def sides(self) -> int:
        """Passes of the histories: 2 where the strokes of a resistance differ, else 1."""
        return max(table.sides for table in self.tables)

    def simulate(self, law: PassTable, states: Array | None = None) -> PoolForces:
        """Simulate the periodic regime of a law on every drive; states of a similar law save passes."""
        stiffness, which = self.drives[:, 0], self.drives[:, 2].astype(np.int64)
        count, middle = len(stiffness), len(law.starts) // 2
        spring = np.column_stack([np.full(count, self.mass), stiffness, self.damping])
        if states is None:
            states = np.zeros((count, SIZE + UNKNOWNS**2))
            x, rest = law.position[middle], np.array([table.forces[-1] for table in self.tables])
            ahead, back = np.array([table.numbers for table in self.tables])[which, :2, DISTANCE].T
            states[:, ELONGATION] = (self.mass * law.starts[middle] + rest[which]) / stiffness
            states[:, HEADING], states[:, FRONT] = 1.0, np.maximum(x, ahead)
            states[:, BACK_FRONT], states[:, BACK_ORIGIN] = -x + back, -x
        forces, states = np.empty((count, self.sides, len(law.velocity))), states.copy()
        tables, passes = TravelTable(*(np.array(each) for each in zip(*self.tables, strict=True))), np.zeros(count, int)

        def fill(first: int) -> None:
            part = slice(first, first + THREAD_DRIVES)
            passes[part] = simulate_all(spring[part], which[part], tables, law, states[part], forces[part])

        threads = cores() if parent_process() is None else 1  # a worker has one processor
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(fill, range(0, count, THREAD_DRIVES)))
        return PoolForces(forces.reshape(count, self.sides * len(law.velocity)), states, passes)
