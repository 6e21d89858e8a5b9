"""Mix of a scene, and its law for each kind of contact: elastic, viscoelastic, or with irreversible compaction."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from compact.material.earth_pressure import drucker_prager_cap
from compact.material.laws import Compaction, Elastic, Viscoelastic
from compact.material.mix import LOOSE_DENSITY_RATIO, Mix, prior
from compact.scene.loader import Scene

# parameters of the mix that both laws of compaction take, and those of the cap with a shear line
COMMON = ("unloading_modulus", "poisson", "heckel_slope", "rate_sensitivity", "reference_rate")
DRUCKER_PRAGER = ("friction_angle", "earth_pressure_coefficient", "dilatancy_angle", "shear_viscosity")


def scene_mix(scene: Scene) -> Mix:
    """Return the mix of a scene: the prior with the overrides of the scene, fitted ones scaled to its moisture."""
    given = scene.mix
    mix = prior(given.moisture, given.density_ratio, given.values)
    origin = "fitted at another moisture or density ratio, scaled by the prior"
    moved = {name: replace(mix.parameter(name), flag="calibrated", origin=origin) for name in given.scaled_fits}
    return replace(mix, parameters=tuple(moved.get(p.name, p) for p in mix.parameters))


def _relaxed(_scene: Scene, mix: Mix) -> Elastic:
    return Elastic(youngs_modulus=mix.effective_modulus, poisson=mix.poisson)


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
    the law "drucker-prager-cap" are those of `earth_pressure`, with the cohesion of loose mix and the earth pressure
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
    "half-plane": _relaxed,
    "linear layer": _viscoelastic,
    "compacting layer": compaction_material,
    "process": compaction_material,
}  # kind of the cases of an engine -> law of the mix
