"""Contacts of a scene: its case for an engine, the contacts of one or several passes, and their scalar results.

    scene -> case_of -> Engine.contact -> ContactRecord

A `ContactRecord` holds the scalar results of one contact, a `PassRecord` those of one pass over a layer with
irreversible compaction. Dictionaries with units exist in JSON only; `contact_to_json` and `contact_from_json` convert.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from compact import quantities
from compact.analysis.failures import is_refusal
from compact.analysis.mix_laws import LAWS
from compact.analysis.multipass import roll_stages, there_and_back
from compact.analysis.pore_air import AirForces, air_under, has_air, pore_air_of
from compact.engines import ENGINES
from compact.engines.interface import Case, Engine
from compact.machine.ranking import first_of
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.material.mix import Mix
from compact.numerics.validation import NotFiniteError, require_finite
from compact.rolling_contact import (
    ContactResult,
    EquilibriumError,
    HeapingError,
    Layer,
    LowerLift,
    Ply,
    Roller,
    UnsteadyError,
)
from compact.scene.engine_capabilities import adapt
from compact.scene.loader import Scene

if TYPE_CHECKING:
    from compact.analysis.process import ProcessDetail, ProcessStudy

Progress = Callable[[str], None]  # of lines of text
Passes = tuple[ContactResult, ...]

COMPACTED = (  # fields of engines with irreversible compaction only
    "exit_density_ratio", "exit_height", "lower_height", "lower_density_ratio", "peak_density_ratio",
    "overdense_work", "mass_residual", "yield_residual", "equilibrium_residual",
    "air_load", "air_resistance", "air_excess_behind",
)  # fmt: skip
COMMON = tuple(name for name in quantities.CONTACT if name not in COMPACTED)
ERRORS = {"load": "load_error", "resistance": "resistance_error"}  # quantity -> field of its relative error
TARGETS = MappingProxyType(  # held quantity -> keyword of `Roller`
    {"height": "indentation", "load": "load", "peak_pressure": "peak_pressure"}
)


@dataclass(frozen=True)
class HeldQuantity:
    """Quantity of the contact that is constant over the speed of the roller.

    The rollers run in fixed guides, so that a resistance over speed requires such a condition. The contact reaches the
    target of the scene at the mean speed of a pass; from that contact the quantity has its value.

    Parameters
    ----------
    name : {"height", "load", "peak_pressure"}
        Height of the lowest generatrix, load or peak pressure.
    value : float
        Indentation [m], load per unit roller length [N/m] or peak pressure [Pa].
    speed : float
        Mean speed of a pass [m/s].
    """

    name: str
    value: float
    speed: float

    @property
    def target(self) -> dict[str, float]:
        """The value as a keyword of `Roller`."""
        return {TARGETS[self.name]: self.value}


def contact_speeds(scene: Scene) -> tuple[float, ...]:
    """Return the speeds of the contacts of a scene [m/s], ascending."""
    if scene.contact is not None and scene.contact.speeds is not None:
        return scene.contact.speeds
    return tuple(scene.mean_speed * share for share in ENGINES[scene.accuracy.engine].speed_shares)


def process_detail(scene: Scene) -> "ProcessDetail":
    """Return the detail of the forming process of a scene by the engine "process", lumped lifts by default."""
    return (scene.process and scene.process.detail) or "quick"


def process_study(scene: Scene, report: Progress | None = None) -> "ProcessStudy":
    """Return the forming process of a scene with the detail of its engine."""
    from compact.analysis.process import ProcessStudy  # finite elements are imported where strokes are computed

    return ProcessStudy(scene, process_detail(scene), report or (lambda _: None))


def nearest_speed(speeds: Iterable[float], speed: float) -> int:
    """Return the position of the speed that is nearest in ratio, the first of several [m/s]."""
    return first_of([abs(math.log(each / speed)) for each in speeds], floor=1.0)


def prescribed_target(scene: Scene) -> dict[str, float]:
    """Return the target of the table [contact] as a keyword of `Roller`; empty without one."""
    target = scene.target
    if "load" in target:
        target["load"] /= scene.machine.roller_length
    return target


def hold_quantity(scene: Scene, mix: Mix, reference: ContactResult | None = None) -> HeldQuantity | None:
    """Determine the quantity that a scene holds constant over speed, and its value.

    It is `contact.held` if the scene sets it, else a prescribed load or peak pressure, else the height.

    Parameters
    ----------
    scene : Scene
        A scene whose engine is layered.
    reference : ContactResult, optional
        Contact at the mean speed that reaches the target of the scene.

    Returns
    -------
    HeldQuantity or None
        None if the value depends on the reference contact and `reference` is None.
    """
    prescribed = next((name for name in ("load", "peak_pressure") if name in scene.target), "height")
    name = (scene.contact and scene.contact.held) or prescribed
    target, value = ENGINES[scene.accuracy.engine].target(case_of(scene, mix, scene.mean_speed))
    if target == TARGETS[name]:
        return HeldQuantity(name, value, scene.mean_speed)
    reached = None if reference is None else float(getattr(reference, TARGETS[name]))
    return None if reached is None else HeldQuantity(name, reached, scene.mean_speed)


def contact_inputs(
    scene: Scene, mix: Mix, engine: str, speed: float, held: HeldQuantity | None = None
) -> tuple[Layer, Roller, Elastic | Viscoelastic | Compaction]:
    """Convert a scene to the arguments of an engine, with the replacements of `engine_capabilities.adapt`.

    Parameters
    ----------
    engine : str
        Name of the engine; "formula" has the relaxed modulus.
    speed : float
        Speed of the roller [m/s].
    """
    require_finite(speed=speed)
    scene, _ = adapt(scene, engine)
    law, target = LAWS[ENGINES[engine].takes], prescribed_target(scene)
    material = law(scene, mix)
    if isinstance(material, Compaction):
        layer, target = _layer_before_pass(scene, material, target, held.speed if held else speed)
    else:
        target = target or {"peak_pressure": mix.required_pressure}
        plies = (Ply(thickness=ply.thickness, stiffness=ply.relative_modulus) for ply in scene.layer.plies or ())
        layer = Layer(scene.lift_thickness, base=scene.layer.base, plies=tuple(plies))
    roller = Roller(
        scene.machine.roller_radius,
        friction=mix.steel_friction,
        rolling=scene.machine.roller_condition,
        profile=scene.machine.gap_geometry,
        **(held.target if held else target),
    )
    return layer, roller, material


class ProcessCase(NamedTuple):
    """Strokes of a forming process at one speed of the cart [m/s]."""

    process: "ProcessStudy"
    speed: float


def case_of(
    scene: Scene,
    mix: Mix,
    speed: float,
    engine: str | None = None,
    held: HeldQuantity | None = None,
    progress: Progress | None = None,
) -> Any:
    """Return the case of a scene for an engine: a `Case`, or a `ProcessCase` for an engine of the forming process.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    engine : str, optional
        Name of the engine; that of the scene by default.
    """
    used, machine = ENGINES[engine or scene.accuracy.engine], scene.machine
    if used.takes == "process":
        return ProcessCase(process_study(scene, progress), speed)
    layer, roller, material = contact_inputs(scene, mix, used.name, speed, held)
    dense = held is None and isinstance(material, Compaction) and not scene.target
    return Case(
        layer=layer,
        roller=roller,
        material=material,
        speed=speed,
        tolerance=scene.accuracy.tolerance,
        exit_density_ratio=scene.mix.density_ratio if dense else None,
        torque=None if machine.roller_torque is None else machine.roller_torque / machine.roller_length,
        factors={
            "rolling_friction": machine.roller_friction + machine.bearing_friction,
            "nonuniformity": machine.pressure_nonuniformity,
            "one_sided": machine.one_sided,
        },
        unlimited=_target_key(scene) in scene.unusual,
        progress=progress,
    )


def _layer_before_pass(
    scene: Scene, material: Compaction, target: dict[str, float], speed: float
) -> tuple[Layer, dict[str, float]]:
    """Return the layer before the pass and the target of the roller.

    With a prescribed target the height conserves the mass, `h_in = h0 k_out/k_in`. Without one, height and indentation
    are those that result in the lift thickness and density of the product after the elastic recovery.
    """
    from compact.engines.column.engine import required_feed

    height, density_ratio = scene.lift_thickness, scene.mix.density_ratio
    given = scene.layer.lower_lift
    lower = None if given is None else LowerLift(**given.model_dump())
    if target:
        fed_height = height * density_ratio / material.fed_density_ratio
        return Layer(fed_height, base=scene.layer.base, lower_lift=lower), target
    radius = scene.machine.roller_radius
    before = required_feed(height, density_ratio, material, speed, radius=radius, lower_lift=lower)
    return Layer(before.height, base=scene.layer.base, lower_lift=lower), {"indentation": before.indentation}


def roll_scene(
    scene: Scene,
    mix: Mix,
    speed: float,
    engine: str | None = None,
    initial_guess: ContactResult | None = None,
    held: HeldQuantity | None = None,
    progress: Progress | None = None,
) -> ContactResult:
    """Compute the contact of one roller of a scene in its first pass.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    engine : str, optional
        Name of the engine; that of the scene by default.
    initial_guess : ContactResult, optional
        Another contact of the engine, which uses it where it serves.
    progress : callable, optional
        Called with lines of text by slow engines.

    Raises
    ------
    ValueError
        If the engine does not cover the scene.
    RuntimeError
        If the engine does not converge, or the roller would reach the base.
    """
    used = ENGINES[engine or scene.accuracy.engine]
    return solve(used, scene, case_of(scene, mix, speed, used.name, held, progress), initial_guess)


def solve(engine: Engine, scene: Scene, case: Any, start: ContactResult | None = None) -> ContactResult:
    """Compute the contact of a case; errors name scene, engine and speed.

    Raises
    ------
    RuntimeError
        If the engine does not converge, or the indentation exceeds the layer, which small strains do not prevent.
    """
    with named_errors(scene, engine.name, case.speed):
        result = engine.contact(case, start)
        indentation, layer = getattr(result, "indentation", 0.0), getattr(case, "layer", None)  # none on a half-plane
        if layer is not None and indentation >= layer.height:
            raise RuntimeError(
                f"the indentation of {indentation:.3g} m reaches the base of a layer {layer.height:g} m high; press "
                "less"
            )
    return result


def roll_passes(
    scene: Scene,
    mix: Mix,
    speed: float,
    initial_guess: Sequence[ContactResult] | None = None,
    held: HeldQuantity | None = None,
    count: int | None = None,
    first: ContactResult | None = None,
    progress: Progress | None = None,
    **numerics: Any,
) -> Passes:
    """Compute the contacts of all passes of a scene, forward and back over the same mix.

    The first pass is that of `roll_scene`. Later ones hold the load or peak pressure that the scene prescribes or
    holds, else the height of the first.

    Parameters
    ----------
    speed : float
        Speed of the first pass [m/s].
    count : int, optional
        Number of passes; that of the scene by default.
    **numerics
        Numerical options of the engine for all passes that are computed.
    """
    count = count or scene.layer.passes
    if count == 1:
        return (roll_scene(scene, mix, speed, None, initial_guess[0] if initial_guess else None, held, progress),)
    engine, case = ENGINES[scene.accuracy.engine], case_of(scene, mix, speed, None, held, progress)
    if initial_guess and engine.equal(case, initial_guess[0]):
        known: Sequence[Any] = initial_guess
        return tuple(replace(each, speed=float(np.copysign(speed, each.speed))) for each in known)
    name, value = engine.target(case)
    forward, *later = there_and_back(count)
    stages = (replace(forward, exit_density_ratio=value if name == "exit_density_ratio" else None), *later)
    with named_errors(scene, engine.name, speed):
        return roll_stages(replace(case, numerics=numerics), stages, engine, first)


@contextmanager
def named_errors(scene: Scene, engine: str, speed: float) -> Iterator[None]:
    """Name scene, engine and speed in errors of an engine."""
    case = f"{scene.title or 'untitled scene'}, {engine} at {speed:g} m/s"
    try:
        yield
    except NotFiniteError as error:  # a quantity of the iteration, as the inputs are finite
        words = "the iteration diverged, a stress or strain is no longer finite; press less, or feed denser mix"
        raise RuntimeError(f"{case}: {words}") from error
    except ValueError as error:
        if "load" not in scene.target or not str(error).startswith("`load`"):
            raise
        load, length = scene.target["load"], scene.machine.roller_length
        raise ValueError(f"{error} (contact.load = {load:g} N over roller_length = {length:g} m)") from error
    except HeapingError as error:
        hint = f'; unusual = ["{_target_key(scene)}"] computes it all the same'
        raise HeapingError(f"{case}: {error}{hint}", error.heaping) from error
    except UnsteadyError as error:
        raise UnsteadyError(f"{case}: {error}", error.unsteady) from error
    except EquilibriumError as error:
        raise EquilibriumError(f"{case}: {error}") from error
    except RuntimeError as error:
        if not is_refusal(error):
            raise
        raise RuntimeError(f"{case}: {error}") from error


def _target_key(scene: Scene) -> str:
    """Return the scene key of the target of the contact."""
    return next((f"contact.{name}" for name in scene.target), "mix.density_ratio")


def _require_above_base(result: ContactResult, layer: Layer) -> None:
    """Raise RuntimeError if the indentation exceeds the layer, which small strains do not prevent."""
    indentation = getattr(result, "indentation", 0.0)  # none on a half-plane
    if indentation >= layer.height:
        raise RuntimeError(
            f"the indentation of {indentation:.3g} m reaches the base of a layer {layer.height:g} m high; press less"
        )


def air_forces_of(scene: Scene, mix: Mix, contact: ContactResult, speed: float) -> AirForces | None:
    """Compute the changes of one contact by its pore air, at its deformation without air.

    Parameters
    ----------
    contact : ContactResult
        First pass without air.
    speed : float
        Speed of the roller [m/s].

    Returns
    -------
    AirForces or None
        None for a scene without pressure of the air.
    """
    if not has_air(scene):
        return None
    layer, roller, _ = contact_inputs(scene, mix, scene.accuracy.engine, speed)
    under = air_under(contact, layer, roller, pore_air_of(mix, scene.layer.fed_density_ratio))
    pressure = under.pressure(speed)
    return AirForces(*under.forces(pressure), under.largest_excess_behind(pressure))


@dataclass(frozen=True)
class PassRecord:
    """Scalar results of one pass of a roller over a layer with irreversible compaction.

    Parameters
    ----------
    load, resistance : float
        Force on the roller per unit length [N/m].
    indentation : float
        Depth of the lowest generatrix below the surface of the layer before the pass [m].
    exit_height : float
        Height of the layer behind the roller [m].
    exit_density_ratio : float
        Mean density ratio of the layer behind the roller [-].
    work_residual, mass_residual : float or None
        Relative residuals of the balances of energy and mass [-].
    """

    load: float
    resistance: float
    indentation: float
    exit_height: float
    exit_density_ratio: float
    work_residual: float | None
    mass_residual: float | None


@dataclass(frozen=True)
class ContactRecord:
    """Scalar results of the contact of one roller at one speed.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    load, resistance : float
        Force on the roller per unit length [N/m].
    load_error, resistance_error : float or None
        Relative error estimates [-]; None where the engine has none.
    coefficient : float
        Rolling-resistance coefficient, resistance over load [-].
    leading, trailing : float
        Edges of the contact from the axis of the roller, positive along the travel [m].
    peak_pressure : float
        Largest contact pressure [Pa].
    indentation : float or None
        Depth of the lowest generatrix below the surface [m]; None on a half-plane.
    creep : float or None
        Creepage of a roller with stick and slip [-].
    work_residual : float or None
        Relative residual of the energy balance [-].
    exit_density_ratio, exit_height, mass_residual : float or None
        Mean density ratio [-] and height [m] behind the first pass, relative residual of the mass balance [-];
        None for a linear layer.
    lower_height, lower_density_ratio : float or None
        Height [m] and mean density ratio [-] of the lower lift behind the first pass; None without one.
    peak_density_ratio, overdense_work, yield_residual, equilibrium_residual : float or None
        Largest density ratio, share of the plastic work beyond the measured pressure curve, largest stress beyond the
        cap over its pressure and relative residual of the forces [-]; None except for the engine "compaction".
    air_load, air_resistance, air_excess_behind : float or None
        Parts of load and resistance by the pore air [N/m], and its largest excess pressure behind the contact [Pa];
        None for drained mix.
    passes : tuple of PassRecord
        All passes in order; empty for a linear layer.
    """

    engine: str
    speed: float
    load: float
    load_error: float | None
    resistance: float
    resistance_error: float | None
    coefficient: float
    leading: float
    trailing: float
    peak_pressure: float
    indentation: float | None
    creep: float | None
    work_residual: float | None
    iterations: int
    exit_density_ratio: float | None = None
    exit_height: float | None = None
    lower_height: float | None = None
    lower_density_ratio: float | None = None
    peak_density_ratio: float | None = None
    overdense_work: float | None = None
    mass_residual: float | None = None
    yield_residual: float | None = None
    equilibrium_residual: float | None = None
    air_load: float | None = None
    air_resistance: float | None = None
    air_excess_behind: float | None = None
    passes: tuple[PassRecord, ...] = ()


def contact_record(
    engine: str, speed: float, passes: tuple[ContactResult, ...], air: AirForces | None = None
) -> ContactRecord:
    """Summarise the results of all passes at one speed; all but `passes` belongs to the first.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    passes : tuple of ContactResult
        Results of the passes in order, at least one, without pore air.
    air : AirForces, optional
        Changes of the first pass by its pore air.
    """
    first = passes[0]
    load_error, resistance_error = first.error or (None, None)
    numbers: dict[str, Any] = {name: getattr(first, name, None) for name in quantities.CONTACT}
    if air is not None:
        numbers["load"] += air.load
        numbers["resistance"] += air.resistance
        numbers |= {"air_load": air.load, "air_resistance": air.resistance, "air_excess_behind": air.excess_behind}
    numbers |= {"speed": speed, "coefficient": numbers["resistance"] / numbers["load"]}
    compacted = passes if hasattr(first, "exit_height") else ()
    records = (PassRecord(**{name: getattr(each, name) for name in quantities.PASS}) for each in compacted)
    return ContactRecord(
        engine=engine, load_error=load_error, resistance_error=resistance_error, iterations=len(first.history),
        passes=tuple(records), **numbers,
    )  # fmt: skip


def contact_to_json(contact: ContactRecord) -> dict[str, Any]:
    """Convert a record to nested dictionaries with "value", "unit" and, where there is an estimate, "error".

    Returns
    -------
    dict
        In the form of "contacts" in summary.json.
    """
    content: dict[str, Any] = {"engine": contact.engine} | {name: _with_unit(contact, name) for name in COMMON}
    for name, error in ERRORS.items():
        content[name]["error"] = getattr(contact, error)
    content["iterations"] = contact.iterations
    content |= {name: _with_unit(contact, name) for name in COMPACTED if getattr(contact, name) is not None}
    if contact.passes:
        content["passes"] = [{name: _with_unit(each, name) for name in quantities.PASS} for each in contact.passes]
    return content


def _with_unit(record: ContactRecord | PassRecord, name: str) -> dict[str, Any]:
    return {"value": getattr(record, name), "unit": quantities.CONTACT[name].unit}


def contact_from_json(content: dict[str, Any]) -> ContactRecord:
    """Read a record back from the form of `contact_to_json`.

    Raises
    ------
    KeyError, TypeError
        If `content` has another form.
    """
    values = {name: content[name]["value"] for name in COMMON}
    errors = {field: content[name]["error"] for name, field in ERRORS.items()}
    compacted = {name: content[name]["value"] for name in COMPACTED if name in content}
    passes = tuple(
        PassRecord(**{name: each[name]["value"] for name in quantities.PASS}) for each in content.get("passes", ())
    )
    return ContactRecord(
        engine=content["engine"], iterations=content["iterations"], passes=passes, **values, **errors, **compacted
    )
