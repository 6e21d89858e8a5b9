"""Contacts of a scene: their inputs, their scalar results as typed records, and the file that keeps these results.

`contact_inputs` converts a scene to layer, roller and material law. A `ContactRecord` holds the scalar results of one
contact, a `PassRecord` those of one pass over a layer with irreversible compaction. Dictionaries with units exist in
JSON only; `contact_to_json` and `contact_from_json` convert.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from compact import quantities
from compact.analysis.engines import ENGINES
from compact.analysis.pore_air import AirForces
from compact.machine.ranking import first_of
from compact.material.earth_pressure import drucker_prager_cap
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.material.mix import LOOSE_DENSITY_RATIO, Mix, prior
from compact.numerics.validation import require_finite
from compact.rolling_contact import ContactResult, Layer, LowerLift, Ply, Roller
from compact.scene.engine_capabilities import adapt
from compact.scene.loader import Scene

COMPACTED = (  # fields of engines with irreversible compaction only
    "exit_density_ratio", "exit_height", "lower_height", "lower_density_ratio", "peak_density_ratio",
    "overdense_work", "mass_residual", "yield_residual", "equilibrium_residual",
    "air_load", "air_resistance", "air_excess_behind",
)  # fmt: skip
COMMON = tuple(name for name in quantities.CONTACT if name not in COMPACTED)
ERRORS = {"load": "load_error", "resistance": "resistance_error"}  # quantity -> field of its relative error
SPEED_SHARES = tuple(2.0**power for power in range(-4, 2))  # [-], of the mean speed; default speeds of the contacts
LAW_SPEED_SHARES = (1 / 16, 1.0)  # [-], of an engine whose resistance is a law of two or three contacts
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


def scene_mix(scene: Scene) -> Mix:
    """Return the mix of a scene: the prior with the overrides of the scene, fitted ones scaled to its moisture."""
    given = scene.mix
    mix = prior(given.moisture, given.density_ratio, given.values)
    origin = "fitted at another moisture or density ratio, scaled by the prior"
    moved = {name: replace(mix.parameter(name), flag="calibrated", origin=origin) for name in given.scaled_fits}
    return replace(mix, parameters=tuple(moved.get(p.name, p) for p in mix.parameters))


def contact_speeds(scene: Scene) -> tuple[float, ...]:
    """Return the speeds of the contacts of a scene [m/s], ascending."""
    if scene.contact is not None and scene.contact.speeds is not None:
        return scene.contact.speeds
    shares = LAW_SPEED_SHARES if ENGINES[scene.accuracy.engine].rate_factor_only else SPEED_SHARES
    return tuple(scene.mean_speed * share for share in shares)


def nearest_speed(speeds: Iterable[float], speed: float) -> int:
    """Return the position of the speed that is nearest in ratio, the first of several [m/s]."""
    return first_of([abs(math.log(each / speed)) for each in speeds], floor=1.0)


def prescribed_target(scene: Scene) -> dict[str, float]:
    """Return the target of the table [contact] as a keyword of `Roller`; empty without one."""
    target = scene.target
    if "load" in target:
        target["load"] /= scene.machine.roller_length
    return target


def has_density_target(scene: Scene, engine: str) -> bool:
    """Return True if the engine iterates to the density of the product; "column" inverts it in closed form."""
    return ENGINES[engine].density_target and not prescribed_target(scene)


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
    speed, engine = scene.mean_speed, scene.accuracy.engine
    target, value = contact_inputs(scene, mix, engine, speed)[1].target
    if target == TARGETS[name] and not has_density_target(scene, engine):
        return HeldQuantity(name, value, speed)
    return HeldQuantity(name, float(getattr(reference, TARGETS[name])), speed) if reference is not None else None


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
    target = prescribed_target(scene)
    material: Elastic | Viscoelastic | Compaction
    if ENGINES[engine].compacting:
        material = compaction_material(scene, mix)
        layer, target = _layer_before_pass(scene, material, target, held.speed if held else speed)
    else:
        target = target or {"peak_pressure": mix.required_pressure}
        plies = (Ply(thickness=ply.thickness, stiffness=ply.relative_modulus) for ply in scene.layer.plies or ())
        layer = Layer(scene.lift_thickness, base=scene.layer.base, plies=tuple(plies))
        material = _linear_material(mix, relaxed=not ENGINES[engine].layered)
    roller = Roller(
        scene.machine.roller_radius,
        friction=mix.steel_friction,
        rolling=scene.machine.roller_condition,
        profile=scene.machine.gap_geometry,
        **(held.target if held else target),
    )
    return layer, roller, material


def _linear_material(mix: Mix, relaxed: bool) -> Elastic | Viscoelastic:
    if relaxed:
        return Elastic(youngs_modulus=mix.effective_modulus, poisson=mix.poisson)
    branches = ((mix.instant_over_relaxed - 1, mix.relaxation_time),) if mix.instant_over_relaxed > 1 else ()
    return Viscoelastic(youngs_modulus=mix.effective_modulus, poisson=mix.poisson, branches=branches)


def compaction_material(scene: Scene, mix: Mix) -> Compaction:
    """Convert the mix of a scene to its law of irreversible compaction.

        M = sqrt(3) sin phi,  pt = c cot phi

    Notes
    -----
    phi and c are the angle of internal friction and the cohesion: the critical state line equals the Mohr-Coulomb
    limit in plane strain at constant volume. Confined compression follows the Heckel curve of mix tables. The slopes of
    the law "drucker-prager-cap" are those of `earth_pressure`, with the cohesion of loose mix and the earth pressure
    coefficient at the required pressure.
    """
    common: dict[str, Any] = {
        "unloading_modulus": mix.unloading_modulus,
        "poisson": mix.poisson,
        "heckel_slope": mix.heckel_slope,
        "loose_density_ratio": LOOSE_DENSITY_RATIO,
        "fed_density_ratio": scene.layer.fed_density_ratio,
        "rate_sensitivity": mix.rate_sensitivity,
        "reference_rate": mix.reference_rate,
    }
    if scene.mix.law == "drucker-prager-cap":
        return drucker_prager_cap(
            friction_angle=mix.friction_angle,
            cohesion=mix.cohesion_loose,
            earth_pressure_coefficient=mix.earth_pressure_coefficient,
            pressure=mix.required_pressure,
            dilatancy_angle=mix.dilatancy_angle,
            shear_viscosity=mix.shear_viscosity,
            **common,
        )
    angle = np.radians(mix.friction_angle)
    return Compaction(
        **common,
        heckel_test="confined",
        critical_slope=float(np.sqrt(3) * np.sin(angle)),
        tensile_strength=float(mix.cohesion / np.tan(angle)),
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
