"""Tables of the force that opposes a cart, over velocity and acceleration, for other programs.

    model = CartModel.of(study)
    table = force_table(model, tolerance=1e-3)
    write_force_csv(table, "force.csv")

The table has the resistance F(v, a) of the mix and the guide friction on one cart. It is interpolated linearly. Nodes
are added until the interpolation meets the tolerance half-way between all nodes. At rest both forces are set-valued:
between -v1 and v1, v1 = REST_SHARE of the mean speed, the table passes linearly through 0.

The CSV file has one line for each node, for Chrono, spreadsheets and any script. Simulink and Modelica tools import the
unit of `functional_mockup`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from compact.analysis.study import Study
from compact.files import write_csv
from compact.machine.cart import Cart, balance
from compact.numerics import Array
from compact.numerics.validation import require_positive
from compact.resistance import DryResistance, ResistanceMap
from compact.turning import StrokeResistance

REST_SHARE = 1e-3  # [-], of the mean speed, below which the table is linear through rest
FIRST_NODES, MAX_NODES = 9, 513  # [-], velocities of one sign, and accelerations
FORCES = ("resistance", "guide_friction", "opposing_force")  # [N]; the last one is the sum
CSV_HEADER = ("velocity_m_s", "acceleration_m_s2", *(f"{name}_N" for name in FORCES))


@dataclass(frozen=True)
class CartModel:
    """Forces on one cart along the rails, and the range of its motion.

    Parameters
    ----------
    resistance : ResistanceMap, DryResistance or StrokeResistance
        Resistance of the mix; the tables hold it far from a turn.
    largest_speed, largest_acceleration : float
        Range of the laws of the scene [m/s], [m/s2].
    mean_speed, stroke : float
        Stroke over duration [m/s], and stroke [m].
    """

    cart: Cart
    resistance: ResistanceMap | DryResistance | StrokeResistance
    largest_speed: float
    largest_acceleration: float
    mean_speed: float
    stroke: float

    @classmethod
    def of(cls, study: Study) -> "CartModel":
        """Return the model of a study.

        Raises
        ------
        ValueError
            If the scene has end springs, whose force depends on the position.
        """
        stages, scene = study.stages, study.scene
        if stages.resistance.cart.end_springs is not None:
            raise ValueError(
                "drive.end_springs: their force depends on the position, which F(v, a) does not contain; remove the "
                "table and add the springs to the other model"
            )
        peaks = [cycle.forward.peaks() for cycle in stages.laws.cycles.values()]
        accelerations = [each.acceleration for each in peaks if np.isfinite(each.acceleration)]
        fastest = stages.resistance.map.speeds[-1] if stages.contacts.speeds else max(each.velocity for each in peaks)
        largest = max(accelerations, default=scene.mean_speed / scene.motion.duration)
        force: Any = stages.resistance.resistance
        return cls(stages.resistance.cart, force, float(fastest), float(largest), scene.mean_speed, scene.motion.stroke)

    def forces(self, velocity: ArrayLike, acceleration: ArrayLike) -> dict[str, Array]:
        """Compute resistance, guide friction and their sum [N] at velocities [m/s] and accelerations [m/s2]."""
        velocity, acceleration = np.broadcast_arrays(np.asarray(velocity, float), np.asarray(acceleration, float))
        resistance = self.resistance(velocity, acceleration)
        friction = balance(self.cart, acceleration, resistance, np.sign(velocity)).guide_friction
        return dict(zip(FORCES, (resistance, friction, resistance + friction), strict=True))


class ForceTable(NamedTuple):
    """Forces on one cart over a grid.

    Parameters
    ----------
    velocity : ndarray, shape (n,)
        Ascending [m/s].
    acceleration : ndarray, shape (m,)
        Ascending [m/s2].
    forces : dict of str to ndarray, shape (n, m)
        FORCES against the motion [N], with the sign of the velocity.
    mass : float
        Mass of the cart [kg], not part of the forces: drive force = mass * acceleration + opposing force.
    interpolation_error : float
        Largest error of linear interpolation over the largest force [-].
    """

    velocity: Array
    acceleration: Array
    forces: dict[str, Array]
    mass: float
    interpolation_error: float


def force_table(model: CartModel, tolerance: float) -> ForceTable:
    """Tabulate the forces of a model.

    Parameters
    ----------
    tolerance : float
        Largest error of linear interpolation over the largest force [-].

    Raises
    ------
    RuntimeError
        If MAX_NODES nodes do not meet the tolerance.
    """
    require_positive(tolerance=tolerance)
    speeds, accelerations = FIRST_NODES, FIRST_NODES
    while True:
        positive = np.geomspace(REST_SHARE * model.mean_speed, model.largest_speed, speeds)
        velocity = np.concatenate([-positive[::-1], [0.0], positive])
        acceleration = np.linspace(-1, 1, accelerations) * model.largest_acceleration
        forces = model.forces(velocity[:, None], acceleration)
        across, along = _interpolation_errors(model, velocity, acceleration, forces["opposing_force"])
        error = max(across, along)
        if error <= tolerance:
            return ForceTable(velocity, acceleration, forces, model.cart.mass, error)
        speeds, accelerations = (2 * speeds - 1, accelerations) if across >= along else (speeds, 2 * accelerations - 1)
        if max(speeds, accelerations) > MAX_NODES:
            raise RuntimeError(
                f"{MAX_NODES} nodes interpolate the force within {error:.1e} of its largest value, tolerance "
                f"{tolerance:g}; raise the tolerance"
            )


def _interpolation_errors(model: CartModel, velocity: Array, acceleration: Array, force: Array) -> tuple[float, float]:
    """Errors of the opposing force between speeds and between accelerations, over its largest value; not at rest."""

    def error(speeds: Array, changes: Array, interpolated: Array) -> float:
        wrong = np.abs(interpolated - model.forces(speeds[:, None], changes)["opposing_force"])
        return float(wrong.max() / np.abs(force).max())

    moving, apart = velocity != 0, velocity[:-1] * velocity[1:] > 0
    middle, between = ((nodes[:-1] + nodes[1:]) / 2 for nodes in (velocity, acceleration))
    across = error(middle[apart], acceleration, (force[:-1] + force[1:])[apart] / 2)
    return across, error(velocity[moving], between, (force[:, :-1] + force[:, 1:])[moving] / 2)


def write_force_csv(table: ForceTable, path: Path | str) -> Path:
    """Write one line for each node, acceleration fastest; return the path."""
    grids = np.meshgrid(table.velocity, table.acceleration, indexing="ij")
    columns = [each.ravel() for each in (*grids, *table.forces.values())]
    return write_csv(Path(path), CSV_HEADER, np.column_stack(columns).tolist())
