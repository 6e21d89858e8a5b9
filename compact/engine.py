"""From a scene to one contact: the layer, the roller and the material of the scene, and the engines by name.

Every engine is a module with `roll(layer, roller, material, speed) -> Rolled`; it is imported when it is asked for.
"""

from importlib import import_module
from types import MappingProxyType

import numpy as np

from compact.material import Elastic, Viscoelastic
from compact.records import Layer, Roller

ENGINES = MappingProxyType({"formula": "compact.contact", "spectral": "compact.spectral", "fem": "compact.fem"})
LINEAR = ("spectral", "fem")  # engines of a viscoelastic layer, whose resistance depends on speed
TOLERANCE = MappingProxyType({"spectral": "rtol", "fem": "tolerance"})  # what an engine calls its wanted error
SPEEDS = 6  # computed where the scene names none: from a twentieth of the mean speed to twice, by equal ratios


def roll(scene, mix, speed, engine=None):
    """The contact of one roller of a scene at a speed [m/s], by the scene's engine or another one; a `Rolled`.

    The scene's tolerance is what the engine is asked for, where it can be asked.

    Raises what the engine raises: ValueError for what it does not cover, RuntimeError where it does not converge.
    """
    name = engine or scene.accuracy.engine
    layer, roller, material = inputs(scene, mix, name)
    asked = {TOLERANCE[name]: scene.accuracy.tolerance} if name in TOLERANCE else {}
    return import_module(ENGINES[name]).roll(layer, roller, material, speed, **asked)


def inputs(scene, mix, engine):
    """(Layer, Roller, material) of a scene; the formula engine sees the relaxed layer and the parabola."""
    machine, modulus = scene.machine, mix.effective_modulus
    roller = Roller(
        machine.roller_radius,
        friction=mix.steel_friction,
        rolling=machine.rolling,
        profile="parabola" if engine == "formula" else machine.profile,
        **_target(scene, mix),
    )
    layer = Layer(scene.product.height, scene.layer.base)
    if engine == "formula":
        return layer, roller, Elastic(modulus, mix.poisson)
    branches = ((mix.instant_over_relaxed - 1, mix.relaxation_time),) if mix.instant_over_relaxed > 1 else ()
    return layer, roller, Viscoelastic(modulus, mix.poisson, branches)


def _target(scene, mix):
    """What the scene prescribes, per unit roller length; else the pressure that the mix needs."""
    given = {} if scene.contact is None else scene.contact.model_dump(exclude={"speeds"}, exclude_none=True)
    if "load" in given:
        given["load"] /= scene.machine.roller_length
    return given or {"peak_pressure": mix.required_pressure}


def speeds(scene):
    """Speeds [m/s] at which the contact of a scene is computed, rising."""
    if scene.contact is not None and scene.contact.speeds is not None:
        return scene.contact.speeds
    mean = scene.motion.stroke / scene.motion.duration
    return tuple(float(speed) for speed in mean * np.geomspace(1 / 20, 2, SPEEDS))
