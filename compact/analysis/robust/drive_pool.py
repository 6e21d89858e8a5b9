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

STEPS = 1200  # [-], of a pass; twice as many change no peak force by 1e-3
SHARE_SAMPLES = 4096  # [-], of the share over the stroke
SPEED_SAMPLES = 512  # [-], of the steady force over the speeds
SPEED_RANGE = 3.0  # [-], largest tabulated speed of the cart over that of the law; held beyond
SLOWEST = 1e-6  # [-], slowest tabulated speed over the fastest
THREAD_DRIVES = 8  # [-], that a thread simulates at a time; those without periodic regime take ten times as long
MIRRORED = 1e-9  # [-], difference of the shares of both headings that is rounding


def travel_table(cart: Cart, resistance: Resistance, stroke: float, fastest: float) -> TravelTable:
    """Tabulate a resistance over travels up to the stroke [m] and speeds up to `SPEED_RANGE` times the fastest [m/s].

    One that is no `StrokeResistance` is a step at the turn.
    """
    speeds = SPEED_RANGE * fastest * np.linspace(0, 1, SPEED_SAMPLES + 1) ** 2
    forces = evaluate_resistance(resistance, np.maximum(speeds, SLOWEST * speeds[-1]), np.zeros(len(speeds)))
    travels = stroke * np.linspace(0, 1, SHARE_SAMPLES + 1)
    wheels = guide_wheels(cart, float(np.abs(forces).max()) or 1.0)
    if np.abs(wheels[0] - wheels[1, ::-1] * np.array([1, 1, -1])).max() > MIRRORED * np.abs(wheels).max():
        raise ValueError("the guides of `cart` must be those of its mirror image on the return stroke")
    shares = loads = np.ones(len(travels))
    turn = 1.0, 0.0, 0.0, 1.0
    if isinstance(resistance, StrokeResistance):
        force, load = resistance.forward, resistance.forward_load
        shares, loads, turn = force(travels), load(travels), (force.track, force.distance, force.release, load.track)
        if np.abs(shares - resistance.backward(travels)).max() > MIRRORED:
            raise ValueError("both headings of `resistance` must have one share; take each side as a resistance")
    return TravelTable(forces, shares, loads, np.array([speeds[-1], travels[1], *turn, *wheels[0].ravel()]))


def pass_table(law: MotionProfile, steps: int = STEPS) -> PassTable:
    """Tabulate a law of which the return stroke is the mirror image; an even number of steps."""
    phases = np.linspace(0, 1, steps + 1)
    inner = np.array([np.nextafter(phases[:-1], 2.0), np.nextafter(phases[1:], -1.0)])
    starts, ends = law.at_phase(inner, 2)
    return PassTable(law.at_phase(phases, 0), law.at_phase(phases, 1), starts, ends, law.duration / steps, law.stroke)


class PoolForces(NamedTuple):
    """Drive forces of one law on the drives of a pool.

    Parameters
    ----------
    forces : ndarray, shape (drives, n + 1)
        H [N] at the instants of a `PassTable`, of a pass that starts in the middle of the forward stroke.
    states : ndarray, shape (drives, SIZE)
        States there; a start for a similar law.
    passes : ndarray, shape (drives,)
        Simulated passes, 0 where none is periodic.
    """

    forces: Array
    states: Array
    passes: Array

    @property
    def peaks(self) -> Array:
        """Peak force of each drive [N]."""
        return np.abs(self.forces).max(axis=1)

    def powers(self, law: PassTable) -> Array:
        """Drive power H y' [W], shape (drives, n + 1)."""
        return np.asarray(self.forces * from_the_middle(law.velocity))


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
    stiffness, damping : ndarray, shape (drives,)
        k [N/m] and c [N s/m].
    tables : tuple of TravelTable
        Resistances, all with one release.
    which : ndarray of int, shape (drives,)
        Index of the resistance of each drive.
    """

    mass: float
    stiffness: Array
    damping: Array
    tables: Sequence[TravelTable]
    which: Array

    def simulate(self, law: PassTable, states: Array | None = None) -> PoolForces:
        """Simulate the periodic regime of a law on every drive; states of a similar law save passes."""
        count, middle = len(self.stiffness), len(law.starts) // 2
        numbers = np.array([table.numbers for table in self.tables])
        spring = np.column_stack([np.full(count, self.mass), self.stiffness, self.damping])
        if states is None:
            states = np.zeros((count, SIZE + UNKNOWNS**2))
            x, rest = law.position[middle], np.array([table.forces[-1] for table in self.tables])
            distance = numbers[self.which, DISTANCE]
            states[:, ELONGATION] = (self.mass * law.starts[middle] + rest[self.which]) / self.stiffness
            states[:, HEADING], states[:, FRONT] = 1.0, np.maximum(x, distance)
            states[:, BACK_FRONT], states[:, BACK_ORIGIN] = -x + distance, -x
        forces, states = np.empty((count, len(law.velocity))), states.copy()
        tables = TravelTable(*(np.array(each) for each in zip(*self.tables, strict=True)))
        which, passes = np.asarray(self.which, np.int64), np.zeros(count, np.int64)

        def fill(first: int) -> None:
            part = slice(first, first + THREAD_DRIVES)
            passes[part] = simulate_all(spring[part], which[part], tables, law, states[part], forces[part])

        threads = cores() if parent_process() is None else 1  # a worker has one processor
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(fill, range(0, count, THREAD_DRIVES)))
        return PoolForces(forces, states, passes)
