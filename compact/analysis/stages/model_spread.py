"""Spread of load and resistance over the laws of the mix: an error of the model, not of mesh or inputs.

The yield surface of loose mix decides the height of the bow wave ahead of the roller, and no publication states it. The
contact at the mean speed is therefore computed again by the other law of `[mix]`. "drucker-prager-cap" has the ends of
the spread of the cohesion of loose mix, too, and the law of the scene those of the saturation limit, which mix below a
roller reaches in two dimensions, but not in columns. All contacts hold the quantity that the scene holds. Ratios to the
law of the scene on the same mesh contain little discretisation error, so that a coarse mesh is sufficient.

A law by which the mix heaps up in front of the roller has no ratio, but the height of the wave and the travel.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from compact.analysis.contact_cases import HeldQuantity, case_of, scene_mix, solve
from compact.engines import ENGINES
from compact.engines.interface import Case
from compact.material.mix import Mix
from compact.rolling_contact import Heaping
from compact.scene.loader import Scene

# elements per contact length of "compaction" [-], with 7 the ratios change by up to 3 %; tolerance of the steady state
# [-], the waves of loose mix scatter by as much
COARSE: dict[str, Any] = {"numerics": {"increments": 4, "steady_tolerance": 1e-2}, "unlimited": False}
LINE = "drucker-prager-cap"


@dataclass(frozen=True)
class LawVariant:
    """Contact of one roller by one law of the mix.

    Parameters
    ----------
    law : {"ellipse", "drucker-prager-cap"}
        Yield surface.
    cohesion_loose : float or None
        Cohesion of loose mix [Pa]; None for the ellipse, whose subcritical side follows from the cap.
    saturation_limit : float
        Density ratio that mix at rest does not exceed [-].
    load, resistance : float or None
        Ratios to the law of the scene [-]; None without a steady state.
    heaping : Heaping or None
        Numbers of a bow wave without a steady state.
    reason : str
        Reason without a steady state, in words.
    """

    law: str
    cohesion_loose: float | None
    saturation_limit: float
    load: float | None = None
    resistance: float | None = None
    heaping: Heaping | None = None
    reason: str = ""


@dataclass(frozen=True)
class ModelSpread:
    """Contacts by other laws of the mix.

    Parameters
    ----------
    variants : tuple of LawVariant
        Other laws and cohesions.
    """

    variants: tuple[LawVariant, ...]

    @property
    def load(self) -> tuple[float, float]:
        """Least and largest load over that of the scene [-]."""
        return self._band("load")

    @property
    def resistance(self) -> tuple[float, float]:
        """Least and largest resistance over that of the scene [-]."""
        return self._band("resistance")

    def _band(self, name: str) -> tuple[float, float]:
        ratios = [1.0, *(ratio for each in self.variants if (ratio := getattr(each, name)) is not None)]
        return min(ratios), max(ratios)


def scenes_of_laws(scene: Scene, mix: Mix) -> tuple[Scene, ...]:
    """Return the scene, and its changes to the other laws of the mix.

    Parameters
    ----------
    scene : Scene
        Scene with a compacting engine.
    mix : Mix
        Its mix, whose cohesion of loose mix has a value and a spread.

    Returns
    -------
    tuple of Scene
        The scene first; the shear line at the low end, the value and the high end of the cohesion; the ends of the
        saturation limit.
    """
    spread, limit, own = mix.parameter("cohesion_loose"), mix.parameter("saturation_limit"), scene.mix.law == LINE
    changes: list[dict[str, Any]] = [{"mix.law": "ellipse"}] if own else []
    changes += [
        {"mix.law": LINE, "mix.overrides.cohesion_loose": cohesion}
        for cohesion in dict.fromkeys((spread.low, spread.value, spread.high))
        if not own or cohesion != spread.value
    ]
    changes += [{"mix.overrides.saturation_limit": end} for end in (limit.low, limit.high) if end != limit.value]
    return scene, *(scene.replaced(**keys) for keys in changes)


def contact_by_law(held: HeldQuantity, stage_of: Callable[[Scene], Any], scene: Scene) -> LawVariant:
    """Compute the contact by the law of a scene at the mean speed, on a coarse mesh of its own engine.

    Parameters
    ----------
    held : HeldQuantity
        Quantity that the contact holds.
    stage_of : callable
        Returns the contact stage of a scene.
    scene : Scene
        Scene with the law.

    Returns
    -------
    LawVariant
        With load and resistance of one roller in N/m.
    """
    stage = stage_of(scene)
    stage.held = held
    cohesion = stage.mix.cohesion_loose if scene.mix.law == LINE else None
    variant = LawVariant(scene.mix.law, cohesion, stage.mix.saturation_limit)
    try:
        case = stage.case(scene.mean_speed)
        rolled = stage.engine.contact(replace(case, **COARSE) if isinstance(case, Case) else case)
    except (ValueError, RuntimeError) as error:
        return replace(variant, heaping=getattr(error, "heaping", None), reason=str(error))
    return replace(variant, load=rolled.load, resistance=rolled.resistance)


def spread_of(contacts: Sequence[LawVariant]) -> ModelSpread:
    """Divide load and resistance of contacts by those of the first, by the law of the scene.

    Parameters
    ----------
    contacts : sequence of LawVariant
        Contacts of `contact_by_law` in the order of `scenes_of_laws`.

    Returns
    -------
    ModelSpread

    Raises
    ------
    RuntimeError
        If the first has no steady state.
    """
    own, *others = contacts
    if own.load is None or own.resistance is None:
        raise RuntimeError(own.reason)
    return ModelSpread(tuple(
        each if each.load is None or each.resistance is None
        else replace(each, load=each.load / own.load, resistance=each.resistance / own.resistance)
        for each in others
    ))  # fmt: skip


def unfitted(scene: Scene, engine: str) -> Scene | None:
    """Return the scene of an engine on the layer of a scene, with the prior in place of the fitted mix.

    Friction of the roller and density as fed, which have no prior, remain those of the scene.

    Returns
    -------
    Scene or None
        None where no fitted value is set, and for strokes of a forming process.
    """
    given = scene if engine == scene.accuracy.engine else scene.with_engine(engine)
    fitted = given.mix.fitted_at.parameters if given.mix.fitted_at else ()
    keys = [key for key in (f"mix.overrides.{name}" for name in fitted) if given.is_set(key)]
    if not keys or ENGINES[engine].reads("process"):
        return None
    layer = {f"layer.{name}": getattr(scene.layer, name) for name in ("lift_thickness", "fed_density_ratio")}
    try:
        return given.replaced(**{"compare": None, "mix.fitted_at": None, **layer, **dict.fromkeys(keys)})
    except ValueError:
        return None


def prior_forces(scene: Scene | None) -> tuple[float, float] | None:
    """Return the load on a roller and the resistance of a cart [N] of a scene at the mean speed, on a coarse mesh.

    Returns
    -------
    tuple of float or None
        None without a scene or a steady state.
    """
    if scene is None:
        return None
    engine, mix = ENGINES[scene.accuracy.engine], scene_mix(scene)
    try:
        case = case_of(scene, mix, scene.mean_speed, engine.name, None, None)
        with warnings.catch_warnings(action="ignore"):  # of the range of a prior that nobody asked for
            found = solve(engine, scene, case if engine.affordable else replace(case, **COARSE))
    except (ValueError, RuntimeError):
        return None
    length = scene.machine.roller_length
    return found.load * length, found.resistance * length * scene.machine.rollers
