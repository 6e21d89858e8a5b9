"""From a scene to one contact: the layer, the roller and the material of the scene, and the engines by name.

Every engine is a module with `roll(layer, roller, material, speed) -> ContactResult`, imported on first use. Tables ENGINES,
FIELDED and MODULATED hold the modules by the names of the engines, and no other module has such a table.

The rollers run in fixed guides, so that a resistance over speed needs a statement of what is kept while the speed
changes. `HeldQuantity` is that statement. The target of the scene (a prescribed indentation, load or peak pressure, else the
required pressure of a linear layer or the density of a compacted product) is met at the mean speed of a pass; from
that contact the height of the roller, its load or its peak pressure is kept at every other speed.
"""

from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from types import MappingProxyType

import numpy as np

from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.material.mix import LOOSE_DENSITY_RATIO
from compact.numerics.validation import NotFiniteError, require_finite, require_known
from compact.rolling_contact import Layer, Ply, Roller
from compact.scene.engine_capabilities import TURNED, adapt

ENGINES = MappingProxyType(
    {
        "formula": "compact.contact",
        "column": "compact.engines.column.engine",
        "spectral": "compact.engines.spectral.engine",
        "fem": "compact.engines.fem.engine",
        "compaction": "compact.engines.compaction.engine",
    }
)
COMPACTING = ("column", "compaction")  # engines of a layer that stays pressed
LAYERED = ("column", "spectral", "fem", "compaction")  # engines of a layer, whose resistance depends on speed
FIELDED = MappingProxyType(
    {"fem": "compact.engines.fem.fields", "compaction": "compact.engines.compaction.results"}
)  # engines with fields inside
MODULATED = MappingProxyType(
    {"spectral": "compact.engines.spectral.speed_derivative", "fem": "compact.engines.fem.speed_derivative"}
)  # linear
TOLERANCE = MappingProxyType({"spectral": "rtol", "fem": "tolerance"})  # what an engine calls its wanted error
REBOUND = 5e-5  # of the layer's height as fed, which follows from that of the product; speed moves its rebound by less
SPEEDS = tuple(2.0**power for power in range(-4, 2))  # of the mean speed: computed where the scene names none
TARGETS = MappingProxyType({"height": "indentation", "load": "load", "peak_pressure": "peak_pressure"})  # of a roller


def solver(engine):
    """The function `roll` of an engine of ENGINES, by its name."""
    return import_module(ENGINES[engine]).roll


def modulation(layer, roller, material, speed, engine="spectral", **accuracy):
    """The `ResistanceExpansion` of a roller on a linear layer at a speed, by an engine of MODULATED.

    accuracy : keywords of the engine: "spectral" rtol; "fem" mesh, tolerance, estimate

    See `spectral_modulation` and `fem_modulation` for the cases covered.

    >>> from compact.material.laws import Viscoelastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> found = modulation(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.05)
    >>> f"{found.resistance:.2f} N/m, {found.slope:.1f} N s/m2, {found.added_mass:.3f} N s2/m2"
    '376.42 N/m, 2937.5 N s/m2, -37.732 N s2/m2'
    """
    require_known("engine with memory in time", engine, MODULATED)
    return import_module(MODULATED[engine]).modulation(layer, roller, material, speed, **accuracy)


@dataclass(frozen=True)
class HeldQuantity:
    """Quantity of the contact that is kept while the speed of the roller changes.

    Parameters
    ----------
    name : "height" of the lowest generatrix, "load" or "peak_pressure"
    value : indentation [m], load per unit roller length [N/m] or peak pressure [Pa]
    speed : mean speed of a pass [m/s], at which the value meets the target of the scene
    """

    name: str
    value: float
    speed: float

    @property
    def target(self) -> dict[str, float]:
        """The value as a keyword of `Roller`."""
        return {TARGETS[self.name]: self.value}


def held_quantity(scene) -> str:
    """Name of the quantity that a scene keeps over speed: as `[contact] held` says, else a prescribed load or peak
    pressure, else the height."""
    if scene.contact is not None and scene.contact.held is not None:
        return scene.contact.held
    return next((name for name in ("load", "peak_pressure") if name in _prescribed(scene)), "height")


def held(scene, mix, reference=None) -> HeldQuantity | None:
    """The `HeldQuantity` of a scene by its engine, one of LAYERED; None if it takes a `reference` and none is given.

    Parameters
    ----------
    scene, mix : of one study
    reference : `ContactResult` at the mean speed of a pass, with the target of the scene met there, or None
    """
    name, speed, engine = held_quantity(scene), scene.mean_speed, scene.accuracy.engine
    given, value = inputs(scene, mix, engine, speed)[1].target
    if given == TARGETS[name] and not _density_wanted(scene, engine):
        return HeldQuantity(name, value, speed)
    return reference and HeldQuantity(name, float(getattr(reference, TARGETS[name])), speed)


def roll(scene, mix, speed, engine=None, near=None, held=None, progress=None):
    """The contact of one roller of a scene in its first pass, at a speed [m/s], by its engine or another; a `ContactResult`.

    The scene's tolerance is passed to engines that take one. `near` is a contact at another speed the same way or of
    another mix, which "compaction" takes as its initial guess over the same fed layer; if nothing but the speed differs
    and the mix has no rate, it is returned with the new speed. `held` is kept in place of the scene's target; without
    it the target of the scene is met at this speed. `progress` is called with lines of text by "compaction".

    Raises ValueError for what the engine does not cover; RuntimeError, naming scene, engine and speed, where it does
    not converge or the roller would reach the base.
    """
    name = engine or scene.accuracy.engine
    layer, roller, material = inputs(scene, mix, name, speed, held)
    asked = _asked(scene, name, held, progress)
    if name == "compaction" and _helps(near, layer, speed):
        if _same(roller, material, near, speed):
            return replace(near, speed=speed)
        asked["start"], layer = near, near.layer
    with _named(scene, name, speed):
        rolled = solver(name)(layer, roller, material, speed, **asked)
        _refuse_below_the_base(rolled, layer)
    return rolled


def _helps(near, layer, speed):
    """Whether a contact is of the same layer as fed, but for what the speed does to its rebound, and goes that way."""
    if near is None or near.speed * speed <= 0:
        return False
    return replace(near.layer, height=layer.height) == layer and abs(near.layer.height / layer.height - 1) < REBOUND


def _same(roller, material, near, speed):
    """Whether nothing differs but the speed, and the mix has no rate."""
    if speed == near.speed or material != near.material:
        return False
    as_found = replace(near.roller, indentation=near.indentation, load=None, peak_pressure=None)
    blind = material.rate_factor(speed) == material.rate_factor(near.speed)
    return blind and roller in (near.roller, as_found)


def added_mass(scene, mix, speed, held, count=lambda stage: None):
    """(M of one roller per unit length [kg/m], tau [s]) at a speed, see `modulation`; None where it is not known.

    M belongs to the quantity `held`, which is kept while the speed changes.

    Layers that stay pressed remember the way and not the time: M = 0, of "compaction" where the mix knows no rate. A
    roller that sticks and slips is given the M of one without friction, whose dF/dv is its own within about a tenth.
    """
    name = scene.accuracy.engine
    layer, roller, material = inputs(scene, mix, name, speed, held)
    if name in COMPACTING:
        return (0.0, 0.0) if name == "column" or not material.rate_exponent else None
    if name == "fem" and roller.rolling in ("free", "driven"):
        roller = replace(roller, rolling="frictionless")
    count("added mass")
    asked = {TOLERANCE[name]: scene.accuracy.tolerance} | ({"estimate": False} if name == "fem" else {})
    with _named(scene, name, speed):
        found = modulation(layer, roller, material, speed, engine=name, **asked)
    return found.added_mass, found.relaxation_time


def passes(scene, mix, speed, engine=None, near=None, held=None, count=None, first=None, progress=None):
    """The contact of each pass of a scene, there and back over the same mix, `ContactResult`s; the first is that of `roll`.

    Later ones keep the load or peak pressure that the scene prescribes or holds, else the height of the first. `near`
    are those at another speed, used as in `roll`; `held` as in `roll`; `count` of passes in place of the scene's;
    `first` is the contact of the first pass, if that is known; `progress` as in `roll`.
    """
    name, count = engine or scene.accuracy.engine, count or scene.layer.passes
    if name not in COMPACTING or count == 1:
        return (roll(scene, mix, speed, name, near[0] if near else None, held, progress),)
    from compact.analysis.multipass import passes, there_and_back

    layer, roller, material = inputs(scene, mix, name, speed, held)
    if name == "compaction" and near and _helps(near[0], layer, speed) and _same(roller, material, near[0], speed):
        return tuple(replace(passed, speed=float(np.copysign(speed, passed.speed))) for passed in near)
    out, *later = there_and_back(count)
    asked = _asked(scene, name, held, progress)
    numerics = {key: asked.pop(key) for key in ("torque", "progress", "steepest") if key in asked}
    stages = (replace(out, **asked), *later)
    with _named(scene, name, speed):
        return passes(layer, roller, material, speed, stages, engine=name, first=first, **numerics)


@contextmanager
def _named(scene, engine, speed):
    """What does not converge says which scene, engine and speed."""
    case = f"{scene.title or 'untitled scene'}, {engine} at {speed:g} m/s"
    try:
        yield
    except NotFiniteError as error:  # a quantity of the iteration, as what enters is finite
        raise RuntimeError(
            f"{case}: the iteration diverged, a stress or strain is no longer finite; press less, or feed denser mix"
        ) from error
    except ValueError as error:
        if "load" not in scene.target or not str(error).startswith("`load`"):
            raise
        machine, load = scene.machine, scene.target["load"]
        raise ValueError(
            f"{error} (contact.load = {load:g} N over roller_length = {machine.roller_length:g} m)"
        ) from error
    except RuntimeError as error:
        insist = f'; unusual = ["{_target_key(scene)}"] computes it all the same' if _is_estimate(error) else ""
        raise RuntimeError(f"{case}: {error}{insist}") from error


def _is_estimate(error):
    """True for a refusal of the engine "compaction" by its estimate of the depth that the mix takes up."""
    return type(error).__name__ == "HeapingError"  # its module need not be imported for the other engines


def _asked(scene, engine, held, progress):
    """Further arguments of an engine.

    The tolerance; for "formula" the factors of eqs 1.6 and 1.8; for those of TURNED the torque per unit roller length
    [N]; for "compaction" the density of the product, if nothing is prescribed or held, and whether to leave out
    its estimate of heaping.
    """
    asked = {TOLERANCE[engine]: scene.accuracy.tolerance} if engine in TOLERANCE else {}
    if engine == "formula":
        machine = scene.machine
        asked["rolling_friction"] = machine.roller_friction + machine.bearing_friction
        asked |= {"nonuniformity": machine.pressure_nonuniformity, "one_sided": machine.one_sided}
    if engine in TURNED and scene.machine.roller_torque is not None:
        asked["torque"] = scene.machine.roller_torque / scene.machine.roller_length
    if engine == "compaction" and progress is not None:
        asked["progress"] = progress
    if engine == "compaction" and _target_key(scene) in scene.unusual:
        asked["steepest"] = None
    if held is None and _density_wanted(scene, engine):
        asked["exit_density_ratio"] = scene.mix.density_ratio
    return asked


def _target_key(scene):
    """Key of the target of the contact."""
    return next((f"contact.{name}" for name in scene.target), "mix.density_ratio")


def _density_wanted(scene, engine):
    """The density of the product is a target of its own; columns give the indentation that leaves it in closed form."""
    return engine == "compaction" and not _prescribed(scene)


def _refuse_below_the_base(rolled, layer):
    """Small strains know no base that stops the roller; a load or pressure beyond the layer's would pass it."""
    indentation = getattr(rolled, "indentation", 0.0)  # a half-plane has none
    if indentation >= layer.height:
        raise RuntimeError(
            f"the roller would stand {indentation:.3g} m deep in a layer {layer.height:g} m high, beyond its base; "
            "press less"
        )


def inputs(scene, mix, engine, speed, held=None):
    """(Layer, Roller, material) of a scene as `capabilities.adapt` gives it to an engine; the formula engine sees the
    relaxed layer.

    The roller is given what is `held`, if that is given, else the target of the scene.
    """
    require_finite(speed=speed)
    scene, _ = adapt(scene, engine)
    target = _prescribed(scene)
    if engine in COMPACTING:
        material = compaction(scene, mix)
        layer, target = _fed(scene, material, target, held.speed if held else speed)
    else:
        target = target or {"peak_pressure": mix.required_pressure}
        plies = (Ply(ply.thickness, ply.relative_modulus) for ply in scene.layer.plies or ())
        layer, material = Layer(scene.lift_thickness, scene.layer.base, tuple(plies)), _linear(mix, engine)
    roller = Roller(
        scene.machine.roller_radius,
        friction=mix.steel_friction,
        rolling=scene.machine.roller_condition,
        profile=scene.machine.gap_geometry,
        **(held.target if held else target),
    )
    return layer, roller, material


def _prescribed(scene):
    """The target of `[contact]`, per unit roller length; empty without one."""
    given = scene.target
    if "load" in given:
        given["load"] /= scene.machine.roller_length
    return given


def _linear(mix, engine):
    branches = ((mix.instant_over_relaxed - 1, mix.relaxation_time),) if mix.instant_over_relaxed > 1 else ()
    if engine == "formula":
        return Elastic(mix.effective_modulus, mix.poisson)
    return Viscoelastic(mix.effective_modulus, mix.poisson, branches)


def compaction(scene, mix):
    """The `Compaction` of a scene's mix.

        M = sqrt(3) sin phi,  pt = c cot phi,  K_H isotropic = A K_H,  A = (1 + sqrt(1 + 4 M^2/9))/2

    phi, c angle of internal friction and cohesion: the cap meets Mohr-Coulomb's limit in plane strain at constant
    volume. A = d s_v/d pc of confined compression turns the one-dimensional slope of mix tables into the isotropic one.
    """
    angle = np.radians(mix.friction_angle)
    slope = float(np.sqrt(3) * np.sin(angle))
    speed = scene.mix.reference_speed
    return Compaction(
        unloading_modulus=mix.unloading_modulus,
        poisson=mix.poisson,
        heckel_slope=mix.heckel_slope * (1 + float(np.sqrt(1 + 4 * slope**2 / 9))) / 2,
        loose_density_ratio=LOOSE_DENSITY_RATIO,
        critical_slope=slope,
        tensile_strength=float(mix.cohesion / np.tan(angle)),
        fed_density_ratio=scene.layer.fed_density_ratio,
        rate_exponent=mix.rate_exponent if speed else 0.0,
        reference_speed=speed,
    )


def _fed(scene, material, target, speed):
    """The layer as fed, and what presses it: h_in = h0 k_out/k_in, or where nothing is prescribed as much mix and
    indentation as leave the lift its height and density after the rebound."""
    from compact.engines.column.engine import required_feed

    height, density_ratio = scene.lift_thickness, scene.mix.density_ratio
    if target:
        return Layer(height * density_ratio / material.fed_density_ratio, scene.layer.base), target
    fed = required_feed(height, density_ratio, material, speed)
    return Layer(fed.height, scene.layer.base), {"indentation": fed.indentation}


def fields(rolled, engine):
    """What happens inside the layer of a contact by an engine of FIELDED, a meshio mesh."""
    return import_module(FIELDED[engine]).fields(rolled)


def speeds(scene):
    """Speeds [m/s] at which the contact of a scene is computed, rising."""
    if scene.contact is not None and scene.contact.speeds is not None:
        return scene.contact.speeds
    return tuple(scene.mean_speed * share for share in SPEEDS)
