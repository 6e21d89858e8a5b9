"""Contacts of a scene: its mix, its case for an engine, the contacts of one or several passes, and their numbers.

scene -> case_of -> Engine.contact -> Contact

The law of the mix is elastic, viscoelastic, or one of irreversible compaction, by the kind of contact of the engine.
Several passes of one roller run forward and back over the same mix, or with fresh mix spread in between:

    for result in passes(layer, roller, material, 0.2, (Pass(), Pass(forward=False), Pass(lift=0.05, height=0.27))):
        print(result.load, result.resistance, result.exit_density_ratio)

Density and residual stress of each row behind a pass are the initial state of the next one. Fresh mix is added on top,
and mass is conserved. The state of the mix has no direction: the return stroke differs from the forward stroke by the
sign of the resistance only.

A second pass at the same height
    In the column model the elastic recovery is reversible: the second pass has no resistance, its load is twice the
    load of the recovery in the first (a quarter in usual mix), its contact is symmetric. A wide thin bonded layer
    behaves alike. A layer that is thick compared with the contact recovers by more than its contact shows. The second
    contact is then short, its peak exceeds that of the first pass, and the top yields again. For a circular roller,
    indentation 2 % of the height, E = 60 MPa and K_H = 13/MPa:

    contact in front over height       8      4      2      1     1/2    1/4
    resistance over that of the first .0012  .0033  .008   .023   .048   .067
    peak pressure over the first      0.99   0.97   0.93   1.04   1.17   1.27

    The table is without a saturation limit. With it, for an indentation of 2 mm in 100 mm under a roller of radius
    110 mm, the ratio is .077 on 8 and on 12 elements; both strokes by elements that move with the mix, without transfer
    of a state, have .076. The top 10 mm, which horizontal tension behind the first pass has loosened, dissipate more
    than 90 % of the work. In further passes the ratio decays to .023 and .017.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from compact.analysis.failures import is_refusal
from compact.engines import ENGINES
from compact.engines.interface import Case, Engine
from compact.engines.pore_air import AirForces
from compact.machine.ranking import first_of
from compact.material.laws import Compaction, Elastic, Viscoelastic, drucker_prager_cap
from compact.material.mix import LOOSE_DENSITY_RATIO, Mix, prior
from compact.numerics import Array, validation
from compact.quantities import PASS
from compact.rolling_contact import Contact, HeapingError, Layer, LowerLift, Ply, Roller
from compact.scene.constraints import adapt
from compact.scene.loader import Scene
from compact.scene.schema import ProcessDetail

Progress = Callable[[str], None]  # of lines of text
Passes = tuple[Contact, ...]

TARGETS = {"height": "indentation", "load": "load", "peak_pressure": "peak_pressure"}  # held -> keyword of `Roller`

# parameters of the mix that both laws of compaction take, and those of the cap with a shear line
COMMON = ("unloading_modulus", "poisson", "heckel_slope", "saturation_limit", "rate_sensitivity", "reference_rate")
DRUCKER_PRAGER = ("friction_angle", "earth_pressure_coefficient", "dilatancy_angle", "shear_viscosity")


def scene_mix(scene: Scene) -> Mix:
    """Return the mix of a scene: the prior with the overrides of the scene, fitted ones scaled to its moisture."""
    given = scene.mix
    mix = prior(given.moisture, given.density_ratio, given.values)
    origin = "fitted at another moisture or density ratio, scaled by the prior"
    moved = {name: replace(mix.parameter(name), flag="calibrated", origin=origin) for name in given.scaled_fits}
    return replace(mix, parameters=tuple(moved.get(p.name, p) for p in mix.parameters))


def _viscoelastic(_scene: Scene, mix: Mix) -> Viscoelastic:
    branches = ((mix.instant_over_relaxed - 1, mix.relaxation_time),) if mix.instant_over_relaxed > 1 else ()
    return Viscoelastic(youngs_modulus=mix.effective_modulus, poisson=mix.poisson, branches=branches)


def compaction_material(scene: Scene, mix: Mix) -> Compaction:
    """Convert the mix of a scene to its law of irreversible compaction.

        M = sqrt(3) sin phi,  pt = c cot phi

    Notes
    -----
    phi and c are the angle of internal friction and the cohesion: the critical state line equals the Mohr-Coulomb
    limit in plane strain at constant volume. Confined compression follows the Heckel curve of mix tables. The slopes of
    the law "drucker-prager-cap" are those of `material.laws`, with the cohesion of loose mix and the earth pressure
    coefficient at the required pressure.
    """
    common: dict[str, Any] = {name: getattr(mix, name) for name in COMMON}
    common |= {"loose_density_ratio": LOOSE_DENSITY_RATIO, "fed_density_ratio": scene.layer.fed_density_ratio}
    if scene.mix.law == "drucker-prager-cap":
        own = {name: getattr(mix, name) for name in DRUCKER_PRAGER}
        return drucker_prager_cap(cohesion=mix.cohesion_loose, pressure=mix.required_pressure, **own, **common)
    angle = np.radians(mix.friction_angle)
    return Compaction(
        **common,
        heckel_test="confined",
        critical_slope=float(np.sqrt(3) * np.sin(angle)),
        tensile_strength=float(mix.cohesion / np.tan(angle)),
    )


LAWS: dict[str, Callable[[Scene, Mix], Elastic | Viscoelastic | Compaction]] = {
    "half-plane": lambda _, mix: Elastic(youngs_modulus=mix.effective_modulus, poisson=mix.poisson),
    "linear layer": _viscoelastic,
    "compacting layer": compaction_material,
    "process": compaction_material,
}  # kind of the cases of an engine -> law of the mix


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


def contact_speeds(scene: Scene) -> tuple[float, ...]:
    """Return the speeds of the contacts of a scene [m/s], ascending."""
    if scene.contact is not None and scene.contact.speeds is not None:
        return scene.contact.speeds
    return tuple(scene.mean_speed * share for share in ENGINES[scene.accuracy.engine].speed_shares)


def process_detail(scene: Scene) -> ProcessDetail:
    """Return the detail of the forming process of a scene by the engine "process", lumped lifts by default."""
    return (scene.process and scene.process.detail) or "deep"


def nearest_speed(speeds: Iterable[float], speed: float) -> int:
    """Return the position of the speed that is nearest in ratio, the first of several [m/s]."""
    return first_of([abs(math.log(each / speed)) for each in speeds], floor=1.0)


def case_of(
    scene: Scene,
    mix: Mix,
    speed: float,
    engine: str | None = None,
    held: HeldQuantity | None = None,
    progress: Progress | None = None,
) -> Case:
    """Return the case of a scene for an engine of single contacts, with the replacements of `constraints.adapt`.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    engine : str, optional
        Name of the engine, that of the scene by default; "formula" has the relaxed modulus.
    """
    validation.require_finite(speed=speed)
    used, machine = ENGINES[engine or scene.accuracy.engine], scene.machine
    adapted, _ = adapt(scene, used.name)
    material, target, exit_density_ratio = used.pick(LAWS)(adapted, mix), adapted.target, None
    if "load" in target:
        target["load"] /= machine.roller_length
    if isinstance(material, Compaction):
        exit_density_ratio = None if held or target else scene.mix.density_ratio
        layer, target = _layer_before_pass(adapted, material, target, held.speed if held else speed)
    else:
        target = target or {"peak_pressure": mix.required_pressure}
        plies = (Ply(thickness=ply.thickness, stiffness=ply.relative_modulus) for ply in adapted.layer.plies or ())
        layer = Layer(adapted.lift_thickness, base=adapted.layer.base, plies=tuple(plies))
    roller = Roller(
        machine.roller_radius,
        friction=mix.steel_friction,
        rolling=adapted.machine.roller_condition,
        profile=adapted.machine.gap_geometry,
        **({TARGETS[held.name]: held.value} if held else target),
    )
    return Case(
        layer=layer,
        roller=roller,
        material=material,
        speed=speed,
        tolerance=scene.accuracy.tolerance,
        exit_density_ratio=exit_density_ratio,
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


@dataclass(frozen=True)
class Pass:
    """One pass of the roller.

    At most one of `height`, `load` and `exit_density_ratio` is given. Without any, the target of the roller holds: its
    load or peak pressure in every pass, its indentation in the first; later passes then keep the height of the one
    before.

    Parameters
    ----------
    lift : float
        Thickness of fresh mix that is spread before the pass [m].
    height : float, optional
        Height of the lowest generatrix above the rigid base [m].
    load : float, optional
        Load per unit roller length [N/m].
    exit_density_ratio : float, optional
        Mean density ratio of the whole layer behind the roller [-].
    forward : bool
        Whether the roller travels along +x.
    """

    lift: float = 0.0
    height: float | None = None
    load: float | None = None
    exit_density_ratio: float | None = None
    forward: bool = True

    def __post_init__(self) -> None:
        validation.require_nonnegative(lift=self.lift)
        names = "height", "load", "exit_density_ratio"
        given = {name: value for name in names if (value := getattr(self, name)) is not None}
        validation.require_positive(**given)
        if len(given) > 1:
            raise ValueError(f"give at most one of `height`, `load`, `exit_density_ratio`, got {sorted(given)}")


class PassEnd(NamedTuple):
    """State of the mix and heights [m] behind a pass, which another process takes as first pass."""

    indentation: float
    exit: Any
    exit_height: float
    lower_height: float | None

    @classmethod
    def of(cls, contact: Any) -> Self:
        """Return the end of a pass over compacting mix."""
        return cls(*(getattr(contact, name) for name in cls._fields))


def there_and_back(count: int) -> tuple[Pass, ...]:
    """Return a number of passes over the same mix, every second one back."""
    validation.require_positive(count=count)
    return tuple(Pass(forward=number % 2 == 0) for number in range(count))


def passes(
    layer: Layer,
    roller: Roller,
    material: Compaction,
    speed: float,
    stages: int | Sequence[Pass],
    *,
    engine: str = "column",
    first: Contact | None = None,
    **numerics: Any,
) -> tuple[Contact, ...]:
    """Compute several passes of one roller.

    Parameters
    ----------
    layer : Layer
        Fresh mix before the first pass; it may lie on a lower lift, to which densities behind a pass do not refer.
    roller : Roller
        Its target holds for passes without their own.
    speed : float
        Speed of forward passes along x [m/s], not 0.
    engine : {"column", "compaction"}

    Returns
    -------
    tuple of Contact
        One contact per pass.

    Examples
    --------
    >>> from compact.rolling_contact import Roller
    >>> mix = Compaction(unloading_modulus=120e6, poisson=0.3, heckel_slope=13e-6,
    ...                  loose_density_ratio=0.72, critical_slope=1.2, tensile_strength=14e3, fed_density_ratio=0.94)
    >>> roller = Roller(0.11, indentation=0.0093617, profile="circle")
    >>> for result in passes(Layer(0.2293617), roller, mix, 0.2, (Pass(), Pass(forward=False))):
    ...     print(f"{result.load:.0f} N/m, {abs(result.resistance):.0f} N/m")
    9639 N/m, 1570 N/m
    2484 N/m, 0 N/m
    """
    validation.require_known("engine", engine, ENGINES)
    if not isinstance(material, Compaction):
        raise ValueError(f"several passes require a `material` Compaction, got {type(material).__name__}")
    stages = there_and_back(stages) if isinstance(stages, int) else tuple(stages)
    case = Case(layer=layer, roller=roller, material=material, speed=speed, numerics=numerics)
    return roll_stages(case, stages, ENGINES[engine], first)


def roll_stages(
    case: Case, stages: Sequence[Pass], engine: Engine, first: Contact | PassEnd | None = None
) -> tuple[Contact, ...]:
    """Compute several passes of the roller of a case; see `passes`."""
    layer, state = case.layer, None  # of the mix behind the last pass; None of fresh mix
    lowest, lower_height = None, 0.0 if layer.lower_lift is None else layer.lower_lift.thickness
    done: list[Any] = []
    for number, stage in enumerate(stages, start=1):
        if stage.lift:
            layer = replace(layer, height=layer.height + stage.lift)
            state = None if state is None else state.with_lift(stage.lift, case.material)
        if number == 1 and first is not None:
            done.append(first)
        else:
            roller = _roller_of(stage, case.roller, layer.height + lower_height, lowest, number)
            speed = case.speed if stage.forward else -case.speed
            target = stage.exit_density_ratio
            now = replace(case, layer=layer, roller=roller, speed=speed, exit_density_ratio=target)
            done.append(engine.roll_over(state, now))
        lowest, state = layer.height + lower_height - done[-1].indentation, done[-1].exit
        layer, lower_height = replace(layer, height=done[-1].exit_height), done[-1].lower_height or 0.0
    return tuple(done)


def density(result: Contact) -> Array:
    """Return the density over the height behind a pass.

    Returns
    -------
    Array, shape (rows, 3)
        Bottom [m], top [m] and density ratio [-] of each row of mix, of a lower lift too, from the base upwards.
    """
    heights, ratios = result.exit.density_rows
    tops = np.cumsum(heights)
    return np.column_stack([tops - heights, tops, ratios])


def _roller_of(stage: Pass, roller: Roller, height: float, lowest: float | None, number: int) -> Roller:
    """Return the roller of a pass; `height` of the surface, `lowest` generatrix in the pass before [m]."""
    if stage.load is not None:
        return replace(roller, load=stage.load, indentation=None, peak_pressure=None)
    target = stage.height
    if target is None and lowest is not None and roller.indentation is not None:
        target = lowest
    if target is None:
        return roller
    if not target < height:
        surface = f"the surface of the mix, {height:.6g} m before pass {number}"
        raise ValueError(f"`height` must be below {surface}, got {float(target)!r}")
    return replace(roller, indentation=height - target, load=None, peak_pressure=None)


def roll_scene(scene: Scene, mix: Mix, speed: float, engine: str | None = None) -> Contact:
    """Compute the contact of one roller of a scene in its first pass.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    engine : str, optional
        Name of the engine; that of the scene by default.

    Raises
    ------
    ValueError
        If the engine does not cover the scene.
    RuntimeError
        If the engine does not converge, or the roller would reach the base.
    """
    return solve(ENGINES[engine or scene.accuracy.engine], scene, case_of(scene, mix, speed, engine))


def solve(engine: Engine, scene: Scene, case: Any, start: Contact | None = None) -> Contact:
    """Compute the contact of a case; errors name scene, engine and speed.

    Raises
    ------
    RuntimeError
        If the engine does not converge, or the indentation exceeds the layer, which small strains do not prevent.
    """
    with named_errors(scene, engine.name, case.speed):
        result = engine.contact(case, start)
        indentation, layer = result.indentation or 0.0, getattr(case, "layer", None)  # none on a half-plane
        if layer is not None and indentation >= layer.height:
            raise RuntimeError(f"{indentation:.3g} m reach the base of a layer {layer.height:g} m high; press less")
    return result


def roll_back(scene: Scene, mix: Mix, numerics: Mapping[str, Any], first: PassEnd) -> tuple[float, float]:
    """Compute load and resistance of a second pass over the mix behind a first one, at the mean speed [N/m]."""
    engine, case = ENGINES[scene.accuracy.engine], case_of(scene, mix, scene.mean_speed)
    with named_errors(scene, engine.name, case.speed):
        back = roll_stages(replace(case, numerics=numerics), there_and_back(2), engine, first)[1]
    return back.load, back.resistance


def on_roller(contact: Contact, length: float) -> dict[str, Any]:
    """Return what can be measured on one roller of a length [m]: load and resistance [N], their ratio, and density."""
    force = abs(contact.resistance)
    forces = {"load": contact.load * length, "resistance": force * length}
    return forces | {"resistance_coefficient": force / contact.load, "exit_density_ratio": contact.exit_density_ratio}


@contextmanager
def named_errors(scene: Scene, engine: str, speed: float) -> Iterator[None]:
    """Name scene, engine and speed in errors of an engine."""
    case = f"{scene.title or 'untitled scene'}, {engine} at {speed:g} m/s"
    try:
        yield
    except validation.NotFiniteError as error:  # a quantity of the iteration, as the inputs are finite
        words = "the iteration diverged, a stress or strain is no longer finite; press less, or feed denser mix"
        raise RuntimeError(f"{case}: {words}") from error
    except ValueError as error:
        if "load" not in scene.target or not str(error).startswith("`load`"):
            raise
        load, length = scene.target["load"], scene.machine.roller_length
        raise ValueError(f"{error} (contact.load = {load:g} N over roller_length = {length:g} m)") from error
    except RuntimeError as error:
        if not is_refusal(error):
            raise
        hint = f'; unusual = ["{_target_key(scene)}"] computes it all the same'
        words = f"{case}: {error}{hint if isinstance(error, HeapingError) else ''}"
        raise type(error)(words, *error.args[1:]) from error  # the rest are numbers of the contact


def _target_key(scene: Scene) -> str:
    """Return the scene key of the target of the contact."""
    return next((f"contact.{name}" for name in scene.target), "mix.density_ratio")


def contact_record(engine: str, speed: float, passes: Passes, air: AirForces | None = None) -> Contact:
    """Return the numbers of the first pass at one speed, with those of all passes over a compacting layer.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    passes : tuple of Contact
        Results of the passes in order, at least one, without pore air.
    air : AirForces, optional
        Changes of the first pass by its pore air.
    """
    first, numbers = passes[0], dict[str, Any]()
    if air is not None:
        numbers = {"load": first.load + air.load, "resistance": first.resistance + air.resistance}
        numbers |= {f"air_{name}": value for name, value in air._asdict().items()}
    compacted = passes if first.exit_height is not None else ()
    rows = ({name: getattr(each, name) for name in PASS} for each in compacted)
    return first.record(engine, speed, passes=tuple(rows), **numbers)
