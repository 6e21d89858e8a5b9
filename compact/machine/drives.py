"""Kinds of drive: the object that each of them is, and their registry.

`drive.kind` of a scene names one of `DRIVES`. Nothing heavy is imported here. Another package adds a kind by an entry
point of the group "compact.drives" that names a `Drive`:

    [project.entry-points."compact.drives"]
    winch = "my_package.registration:WINCH"

A scene then accepts `drive.kind = "winch"`. Methods receive the whole scene; they read its tables `drive`, `motion` and
`machine`.
"""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from compact.numerics.validation import Registry

if TYPE_CHECKING:
    from compact.machine.rigid_drive import Crank, Rigid
    from compact.motion.profile import Cycle

FACTOR = 3.0  # [-], of stiffness and bulk modulus that are assumed, in either direction
INERTIA_FACTOR = 1.5  # [-], of the inertia at the shaft, in either direction
DAMPING_RATIOS = (0.02, 0.2)  # [-], of a cart on a spring
PEAK_TOLERANCE = 1e-4  # [-], of the forces behind a spring; peaks of 63 cycles change by up to 2e-5, in half the time
OVERSHOOT = 2.0  # [-], largest speed of a cart over that of its law, where it deviates from the law
STROKE_TOLERANCE = 1e-6  # [-], relative; strokes with compressible oil, of which a ranking needs dozens
NONE: Mapping[str, Any] = MappingProxyType({})

Table = tuple[str, str, Sequence[Any]]  # file without ending, columns, and their values


class Variant(NamedTuple):
    """Change of the data of a drive or cart within what is known of them.

    Parameters
    ----------
    label : str
        The change in words.
    keys : mapping
        New values by scene key.
    of : tuple of str
        Quantities that differ from the scene, those of `instruments.csv` with how they are measured.
    """

    label: str
    keys: Mapping[str, Any]
    of: tuple[str, ...] = ("drive",)

    def joined(self, other: "Variant") -> "Variant":
        """Return both changes together."""
        return Variant(f"{self.label} and {other.label}", {**self.keys, **other.keys}, self.of + other.of)


STIFFNESS, DAMPING = "stiffness of the drive", "damping of the drive"
INERTIA, OIL, MASS = "inertia of the motor", "bulk modulus of the oil", "mass of the cart"
EDGE = "sleeve distance"


class Drive:
    """Kind of drive that imposes its law; another package subclasses it and defines `make`.

    Attributes
    ----------
    name : str
        Value of `drive.kind`.
    keys : mapping
        Keys of the scene that belong to it -> their content where they must be given, else empty.
    refused : mapping
        Keys of the scene that it does not take -> reason, as a clause for messages.
    needs_rod : bool
        True if the machine must have a connecting rod.
    sets_duration : bool
        True if the drive, not the scene, determines the duration of a pass.
    overshoot : float
        Largest speed of the cart over that of its law [-]; 1 for a cart that follows it.
    driven_end : bool
        True if a driven end follows the law in place of the cart, whose run has a rigid twin, `rigid`.
    realises : bool
        True if a change of the drive is felt in `realised_peaks` alone.
    table : tuple of str
        File and columns of the table of its runs, as of a `TableSpec`; none by default.
    computed : mapping
        Columns of this table that are functions of a run.
    """

    name: str = "rigid"
    keys: Mapping[str, str] = NONE
    refused: Mapping[str, str] = NONE
    needs_rod = False
    sets_duration = False
    overshoot = 1.0
    driven_end = False
    realises = False
    table: tuple[str, str] | None = None
    computed: Mapping[str, Callable[[Any], float]] = NONE

    @property
    def has_shaft(self) -> bool:
        """True for carts on a shaft that a motor turns."""
        return "drive.catalogue" not in self.refused

    def linkage(self, scene: Any, cycle: "Cycle") -> "Rigid | Crank":
        """Return the link between shaft and cart under a law."""
        from compact.machine.rigid_drive import Rigid

        return Rigid()

    def make(self, scene: Any, cycle: "Cycle") -> Any:
        """Build the drive of a law, as `compact.simulate` takes it."""
        return self.linkage(scene, cycle)

    def make_for_peaks(self, scene: Any, cycle: "Cycle") -> Any:
        """Build the drive of a law as coarse as its largest force and power allow."""
        return self.make(scene, cycle)

    def own_runs(self, runs: Sequence[Any]) -> list[Any]:
        """Return the runs that the drive made, the rows of its table."""
        return list(runs)

    def tables(self, runs: Sequence[Any], count: Callable[[str], None]) -> Iterator[Table]:
        """Yield further tables of runs, best law first; `count` is called with the name of a further simulation."""
        yield from ()

    def variants(self, scene: Any) -> Iterator[Variant]:
        """Yield changes of its keys within what is known of them, see `Scene.stated_spread`."""
        yield from ()

    def realised_peaks(self, run: Any) -> dict[str, float]:
        """Return peaks by criterion of what the drive makes of its run; empty where it cannot follow."""
        return {}


class CrankDrive(Drive):
    """Crank: the law of the crank goes through the rod, other laws through a cam."""

    name, needs_rod = "crank", True

    def linkage(self, scene: Any, cycle: "Cycle") -> "Rigid | Crank":
        """Return the rod for the law of a crank without dwells, else a cam."""
        through_rod = cycle.forward.name == "crank" and scene.motion.dwell == 0
        return (crank_of(scene) if through_rod else None) or super().linkage(scene, cycle)


class ElasticKind(Drive):
    """Spring and damper between the driven end and the cart."""

    name, overshoot, driven_end = "elastic", OVERSHOOT, True
    keys = MappingProxyType({
        "drive.stiffness": "it in N/m", "drive.damping": "it in N s/m, 0 for none", "drive.backlash": "",
    })  # fmt: skip
    table = (
        "dynamic-amplification",
        "law=name peak_force_N rigid_peak_force_N=rigid.peak_force dynamic_amplification peak_power_W "
        "rigid_peak_power_W=rigid.peak_power nonuniformity rigid_nonuniformity=rigid.nonuniformity stick_time_s "
        "energy_residual intervals=cost.intervals",
    )

    def make(self, scene: Any, cycle: "Cycle") -> Any:
        """Build the spring of a scene."""
        from compact.machine.elastic_drive import ElasticDrive  # compiled code, imported when required

        given = {key.partition(".")[2]: getattr(scene.drive, key.partition(".")[2]) for key in self.keys}
        return ElasticDrive(**{key: value for key, value in given.items() if value is not None})

    def make_for_peaks(self, scene: Any, cycle: "Cycle") -> Any:
        """Build the spring of a scene with the tolerance of its peaks."""
        return replace(self.make(scene, cycle), tolerance=PEAK_TOLERANCE)

    def variants(self, scene: Any) -> Iterator[Variant]:
        """Yield stiffness and damping, each alone and then together.

        An assumed stiffness is over and times 3, and their square root, at the same damping ratio; an assumed damping
        ratio is .02 and .2.
        """
        stiffness, damping = scene.drive.stiffness, scene.drive.damping
        critical = 2 * math.sqrt(stiffness * scene.machine.mass)
        steps = (1 / FACTOR, FACTOR**-0.5, FACTOR**0.5, FACTOR)
        springs = [("", 1.0), *levels(scene, "drive.stiffness", "stiffness", steps)]
        if scene.stated_spread("drive.damping") is None:
            dampers = [("", damping), *((f"damping ratio {ratio:g}", ratio * critical) for ratio in DAMPING_RATIOS)]
            exponent = 0.5  # of the damping over the stiffness at one damping ratio
        else:
            dampers = [("", damping)]
            dampers += [(label, by * damping) for label, by in levels(scene, "drive.damping", "damping", ())]
            exponent = 0.0
        grid = []
        for (damper, value), (spring, factor) in product(dampers, springs):
            keys = {"drive.stiffness": factor * stiffness, "drive.damping": factor**exponent * value}
            of = tuple(name for name, words in ((STIFFNESS, spring), (DAMPING, damper)) if words)
            grid.append(Variant(" and ".join(filter(None, (spring, damper))), keys, of))
        yield from sorted(grid[1:], key=lambda each: len(each.of))


class MotorKind(CrankDrive):
    """Motor with gear and flywheel; a law with a velocity jump has a rigid drive, because its force is impulsive."""

    name, needs_rod, sets_duration, overshoot = "motor", False, True, OVERSHOOT
    keys = MappingProxyType({"drive.motor": "the table with curve, gear and inertias"})
    table = (
        "motor",
        "law=name period_s least_speed_rad/s largest_speed_rad/s fluctuation peak_motor_torque_Nm peak_motor_power_W "
        "work_of_a_cycle_J nonuniformity energy_residual belt_creep belt_loss_J",
    )
    computed = MappingProxyType({"work_of_a_cycle_J": lambda run: float((run.weights * run.motor_power).sum())})

    def make(self, scene: Any, cycle: "Cycle") -> Any:
        """Build the motor of a scene."""
        from compact.machine.motor_drive import Motor
        from compact.machine.shaft import Belt, Kloss, LinearTorqueCurve

        linked, motor = self.linkage(scene, cycle), scene.drive.motor
        if any(join.order == 1 for join in cycle.discontinuities()):
            return linked
        curve: Kloss | LinearTorqueCurve = LinearTorqueCurve(motor.torque, motor.speed)
        if motor.curve == "kloss":
            curve = Kloss(motor.torque, motor.breakdown_slip, motor.speed)
        belt = None if motor.belt is None else Belt(**motor.belt.model_dump())
        return Motor(curve, motor.gear_ratio, motor.inertia, motor.flywheel_inertia, angles_of(scene), linked, belt)

    def tables(self, runs: Sequence[Any], count: Callable[[str], None]) -> Iterator[Table]:
        """Yield the start from rest under the first law that the motor drives; none where it does not start."""
        from compact.machine.motor_drive import simulate_acceleration_phase

        for run in self.own_runs(runs)[:1]:
            count("run-up")
            try:
                start = simulate_acceleration_phase(run)
            except RuntimeError as error:
                warnings.warn(f"no start from rest under '{run.name}': {error}", stacklevel=2)
            else:
                yield f"run-up-{run.name}", "time_s angle_rad speed_rad/s", (start.time, start.angle, start.speed)

    def own_runs(self, runs: Sequence[Any]) -> list[Any]:
        """Return the runs with a motor."""
        return [run for run in runs if hasattr(run, "load")]

    def variants(self, scene: Any) -> Iterator[Variant]:
        """Yield the inertia of rotor and flywheel times and over 1.5."""
        motor = scene.drive.motor
        keys = {"drive.motor.inertia": motor.inertia, "drive.motor.flywheel_inertia": motor.flywheel_inertia}
        yield from both_ways(scene, "inertia", INERTIA_FACTOR, keys, INERTIA)


class HydraulicKind(Drive):
    """Two cylinders and their throttle valves."""

    name, realises = "hydraulic", True
    keys = MappingProxyType({"drive.hydraulics": "the table with cylinders, pump and oil"})
    refused = MappingProxyType({"drive.catalogue": "has no shaft that a motor turns"})
    table = (
        "hydraulic",
        "law=name lack peak_inlet_pressure_Pa peak_outlet_pressure_Pa peak_flow_m3/s largest_inlet_area_m2 "
        "least_outlet_area_m2 pump_work_J work_on_the_cart_J=energy throttle_heat_J relief_heat_J energy_residual",
    )
    computed = MappingProxyType({
        "peak_inlet_pressure_Pa": lambda run: float(run.valve_flow.inlet_pressure.max()),
        "peak_outlet_pressure_Pa": lambda run: float(run.valve_flow.outlet_pressure.max()),
        "largest_inlet_area_m2": lambda run: float(run.valve_flow.inlet_area.max()),
        "least_outlet_area_m2": lambda run: float(run.valve_flow.outlet_area.min()),
    })  # fmt: skip

    def make(self, scene: Any, cycle: "Cycle") -> Any:
        """Build cylinders, valves and pump of a scene."""
        from compact.machine.hydraulic_drive import Hydraulic

        return Hydraulic(**scene.drive.hydraulics.model_dump())

    def tables(self, runs: Sequence[Any], count: Callable[[str], None]) -> Iterator[Table]:
        """Yield the throttles of every law, and the stroke with compressible oil under the first that they realise."""
        names = "time_s position_m velocity_m/s flow_m3/s inlet_pressure_Pa outlet_pressure_Pa inlet_area_m2 "
        for run in runs:
            values = (run.time, *run.state[:2], *vars(run.valve_flow).values())
            yield f"throttles/{run.name}", f"{names} outlet_area_m2", values
        run = next((run for run in runs if not run.lack), None)
        if run is not None:
            count("passage")
            made = run.simulate_stroke()
            law = run.cycle.forward.position(made.time)
            names = "time_s position_m velocity_m/s law_position_m inlet_pressure_Pa outlet_pressure_Pa"
            values = (made.time, made.position, made.velocity, law, made.inlet_pressure, made.outlet_pressure)
            yield f"passage-{run.name}", names, values

    def variants(self, scene: Any) -> Iterator[Variant]:
        """Yield the bulk modulus of the oil times and over 3, in strokes with compressible oil."""
        keys = {"drive.hydraulics.bulk_modulus": scene.drive.hydraulics.bulk_modulus}
        yield from both_ways(scene, "bulk modulus", FACTOR, keys, OIL)

    def realised_peaks(self, run: Any) -> dict[str, float]:
        """Return the peaks of the forward stroke with compressible oil, which takes about a second.

        The valve areas are those that realise the law with an incompressible oil.
        """
        try:
            stroke = run.simulate_stroke(rtol=STROKE_TOLERANCE)
        except RuntimeError:
            return {}
        force = abs(run.drive.piston_area * (stroke.inlet_pressure - stroke.outlet_pressure))
        return {"peak_force": float(force.max()), "peak_power": float((force * abs(stroke.velocity)).max())}


DRIVES = Registry(Drive, "compact.drives", (Drive(), CrankDrive(), ElasticKind(), MotorKind(), HydraulicKind()))


def crank_of(scene: Any) -> "Crank | None":
    """Build the crank of a scene, its radius half the stroke; None without a rod."""
    from compact.machine.rigid_drive import Crank

    rod = scene.motion.rod_length
    return None if rod is None else Crank(scene.motion.stroke / 2, rod)


def angles_of(scene: Any) -> tuple[float, ...]:
    """Return the crank angle of each cart relative to the first [rad]."""
    from compact.machine.crankshaft import CRANK_ANGLES

    return scene.drive.angles or CRANK_ANGLES[scene.drive.carts]


def levels(scene: Any, key: str, words: str, factors: Sequence[float], item: int = 0) -> list[tuple[str, float]]:
    """Return label and factor of the ends of a value: of its stated spread, or `factors` where it is assumed."""
    spread = scene.stated_spread(key, item)
    if spread is None:
        return [(f"{words} {'÷' if by < 1 else '×'} {max(by, 1 / by):.3g}", by) for by in factors]
    signs = (("−", -1), ("+", 1)) if spread else ()
    return [(f"{words} {sign} {100 * spread:.2g} %", 1 + way * spread) for sign, way in signs]


def both_ways(scene: Any, words: str, factor: float, keys: Mapping[str, float], of: str) -> Iterator[Variant]:
    """Yield the low and the high ends of keys that vary together, over and times a factor where they are assumed."""
    ends = [levels(scene, key, words, (1 / factor, factor)) for key in keys]
    for end in (0, 1):
        moved = {key: found[end] for key, found in zip(keys, ends, strict=True) if found and keys[key]}
        if moved:
            label = next(iter(moved.values()))[0]
            yield Variant(label, {key: by * keys[key] for key, (_, by) in moved.items()}, (of,))
