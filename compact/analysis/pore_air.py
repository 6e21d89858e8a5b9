"""Forces of the pore air in a contact over the speed, from its pressure at the deformation without air.

At one deformation the pressure depends on speed over permeability alone. One curve of load and resistance over this
ratio, from some tens of solutions, thus serves all speeds and all permeabilities: an `AirCurve`. The scene key
`mix.pore_air` decides whether its forces belong to load and resistance.

A coupled contact, whose skeleton yields to the air, is solved for some ratios only. Its changes of load and resistance
over those of the curve are interpolated over the logarithm of the ratio (`CoupledSample`).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from compact.engines import ENGINES
from compact.engines.pore_air import AirForces
from compact.material.mix import Mix, Parameter
from compact.material.pore_air import PoreAir, water_volume
from compact.numerics import Array
from compact.rolling_contact import Contact, Layer, Roller
from compact.scene.loader import Scene

if TYPE_CHECKING:  # scikit-fem is imported where a pressure is computed
    from compact.engines.pore_air.coupled_rolling import CoupledContact
    from compact.engines.pore_air.steady_flow import AirUnderContact

UNDRAINED = 1e17  # [1/(m s)], speed over permeability without drainage; two dimensions are within 0.5 % at 1e16
RATIOS = np.geomspace(1e9, UNDRAINED, 25)  # [1/(m s)], speed over permeability: from drained to undrained
SCALE = 1e-9  # [-], forces over those of the skeleton below which the curve is linear
MAP_NODES = 25  # [-], speeds of a map with air
DEAERATION_SHARE = 0.1  # [-], load of the air over that of the skeleton at the de-aeration speed


class AirAnswer(NamedTuple):
    """Numbers on the pore air of a scene.

    Parameters
    ----------
    permeability : Parameter
        Intrinsic permeability of the fed mix to air with its spread [m2].
    deaeration_speeds : tuple of float or None
        Speed at which the air changes the load by `DEAERATION_SHARE` [m/s], at the value, the low and the high end of
        the permeability; None if the air does not change it by as much.
    at_mean_speed : AirForces
        Changes of the contact at the mean speed per unit length, whether the scene counts them or not.
    shares : (float, float)
        Changes of load and resistance over those without air [-].
    undrained_shares : (float, float)
        The same where no air escapes, at the deformation without air: the other end of the band of the air [-].
    tensile_strength : float
        Isotropic tensile strength of the mix [Pa], which the pressure behind the contact may exceed.
    """

    permeability: Parameter
    deaeration_speeds: tuple[float | None, float | None, float | None]
    at_mean_speed: AirForces
    shares: tuple[float, float]
    undrained_shares: tuple[float, float]
    tensile_strength: float


@dataclass(frozen=True)
class CoupledSample:
    """Coupled contact over the curve at the deformation without air.

    Parameters
    ----------
    ratio : float
        Speed over permeability [1/(m s)].
    load_factor, resistance_factor : float
        Changes of load and resistance over those of the curve [-].
    """

    ratio: float
    load_factor: float
    resistance_factor: float


@dataclass(frozen=True)
class AirCurve:
    """Forces of the air over speed/permeability at the deformation of one contact, per unit length of the roller.

    Parameters
    ----------
    skeleton_load, skeleton_resistance : float
        Load and resistance of the contact without air [N/m].
    ratios : tuple of float
        Speed over permeability [1/(m s)], ascending.
    loads, resistances : tuple of float
        Load and resistance by the air [N/m].
    excesses_behind : tuple of float
        Largest excess pressures behind the contact [Pa].
    coupled : tuple of CoupledSample
        Coupled contacts by ascending ratio, by which the forces are corrected; empty without a correction.
    """

    skeleton_load: float
    skeleton_resistance: float
    ratios: tuple[float, ...]
    loads: tuple[float, ...]
    resistances: tuple[float, ...]
    excesses_behind: tuple[float, ...]
    coupled: tuple[CoupledSample, ...] = ()

    def at(self, speed: float, permeability: float) -> AirForces:
        """Interpolate the forces.

        Parameters
        ----------
        speed : float
            Speed of the roller [m/s].
        permeability : float
            Intrinsic permeability to air of the fed mix [m2].

        Returns
        -------
        AirForces
        """
        return AirForces(*(float(each[0]) for each in self._evaluate(np.array([abs(speed) / permeability]))))

    def deaeration_speed(self, permeability: float, share: float = DEAERATION_SHARE) -> float | None:
        """Return the speed at which the air changes the load by a share of that of the skeleton.

        Parameters
        ----------
        permeability : float
            Intrinsic permeability to air of the fed mix [m2].
        share : float
            Share of the load [-].

        Returns
        -------
        float or None
            Speed [m/s]; None if the air does not reach the share.
        """
        ratios = np.geomspace(self.ratios[0], self.ratios[-1], 40 * len(self.ratios))
        shares = self._evaluate(ratios)[0] / self.skeleton_load
        above = np.flatnonzero(shares >= share)
        if not len(above) or above[0] == 0:
            return None
        ends = slice(above[0] - 1, above[0] + 1)
        return float(permeability * np.exp(np.interp(share, shares[ends], np.log(ratios[ends]))))

    @property
    def undrained(self) -> AirForces:
        """Forces where no air escapes, at the deformation without air."""
        return AirForces(self.loads[-1], self.resistances[-1], self.excesses_behind[-1])

    @cached_property
    def _spline(self) -> PchipInterpolator:
        """Spline of the inverse hyperbolic sines of load, resistance and excess over the logarithm of the ratio."""
        columns = np.array([self.loads, self.resistances, self.excesses_behind])
        return PchipInterpolator(np.log(self.ratios), np.arcsinh(columns / self._scales).T)

    @property
    def _scales(self) -> Array:
        """Values below which the spline is linear in load, resistance and excess, shape (3, 1)."""
        return SCALE * np.array([[self.skeleton_load], [self.skeleton_load], [max(*self.excesses_behind, 1.0)]])

    def _evaluate(self, ratios: Array) -> Array:
        """Return load, resistance and excess at ratios, shape (3, n); proportional below the curve, constant above."""
        low, high = self.ratios[0], self.ratios[-1]
        values = self._scales * np.sinh(self._spline(np.log(np.clip(ratios, low, high))).T)
        values = values * np.minimum(ratios / low, 1.0)
        if self.coupled:  # constant beyond the coupled contacts
            known = np.log([each.ratio for each in self.coupled])
            factors = ([each.load_factor for each in self.coupled], [each.resistance_factor for each in self.coupled])
            for row, column in zip(values, factors, strict=False):
                row *= np.interp(np.log(ratios), known, column)
        return np.asarray(values)


def pore_air_of(mix: Mix, fed_density_ratio: float) -> PoreAir:
    """Return the pore air of a mix.

    Parameters
    ----------
    mix : Mix
        Mix with permeability, moisture and occlusion saturation.
    fed_density_ratio : float
        Density ratio as fed [-].

    Returns
    -------
    PoreAir

    Raises
    ------
    ValueError
        If the fed mix is occluded.
    """
    return PoreAir(
        permeability=mix.air_permeability,
        water=water_volume(mix.moisture),
        fed_density_ratio=fed_density_ratio,
        occlusion_saturation=mix.occlusion_saturation,
    )


def air_under(result: Any, layer: Layer, roller: Roller, air: PoreAir) -> "AirUnderContact":
    """Return the pore air in a contact by columns or by finite elements with irreversible compaction.

    Parameters
    ----------
    result : Contact
        Contact without air.
    layer : Layer
        Layer as fed.
    roller : Roller
        Roller.
    air : PoreAir
        Pore air with its permeability.

    Returns
    -------
    AirUnderContact
    """
    from compact.engines.pore_air.steady_flow import ColumnAir, RollerAir

    return RollerAir(result.solution, air) if hasattr(result, "solution") else ColumnAir(air, layer, roller, result)


def air_curve(under: "AirUnderContact", permeability: float, contact: Contact) -> AirCurve:
    """Compute the curve of a contact.

    Parameters
    ----------
    under : AirUnderContact
        Pore air of the contact.
    permeability : float
        Its permeability [m2].
    contact : Contact
        Contact without air.

    Returns
    -------
    AirCurve
    """
    rows, start = [], None
    for ratio in RATIOS.tolist():
        start = under.pressure(ratio * permeability, start)
        rows.append(under.forces(start))
    loads, resistances, excesses = (tuple(column) for column in np.array(rows).T.tolist())
    return AirCurve(contact.load, abs(contact.resistance), tuple(RATIOS.tolist()), loads, resistances, excesses)


def air_answer(curve: AirCurve, mix: Mix, mean_speed: float) -> AirAnswer:
    """Evaluate a curve for a mix.

    Parameters
    ----------
    curve : AirCurve
        Forces of the air.
    mix : Mix
        Mix, whose permeability has a value and a spread.
    mean_speed : float
        Mean speed of a pass [m/s].

    Returns
    -------
    AirAnswer
    """
    permeability = mix.parameter("air_permeability")
    ends = permeability.value, permeability.low, permeability.high
    found = curve.at(mean_speed, permeability.value)
    value, low, high = (curve.deaeration_speed(each) for each in ends)
    shares, undrained = (
        (each.load / curve.skeleton_load, each.resistance / curve.skeleton_resistance)
        for each in (found, curve.undrained)
    )
    strength = float(mix.cohesion / np.tan(np.radians(mix.friction_angle)))
    return AirAnswer(permeability, (value, low, high), found, shares, undrained, strength)


def has_air(scene: Scene) -> bool:
    """Return True if load and resistance of a scene contain pore air."""
    return ENGINES[scene.accuracy.engine].reads("mix.pore_air") and scene.mix.pore_air != "drained"


def is_coupled(scene: Scene) -> bool:
    """Return True if the contacts of a scene yield to their pore air."""
    return scene.mix.pore_air == "coupled" and scene.accuracy.engine == "compaction"


def nodes_of_map(speeds: Array) -> Array:
    """Return the speeds of a map with air [m/s]: those of the skeleton, and more between them by equal ratios."""
    return np.unique(np.concatenate([speeds, np.geomspace(speeds[0], speeds[-1], MAP_NODES)[1:-1]]))


def coupled_contact(
    contact: Any, air: PoreAir, speed: float, start: "CoupledContact | None" = None
) -> "CoupledContact":
    """Compute a contact that yields to its pore air.

    Parameters
    ----------
    contact : Contact
        Contact without air.
    air : PoreAir
        Pore air.
    speed : float
        Speed of the roller [m/s].
    start : CoupledContact, optional
        Coupled contact at a lower speed, as initial guess.

    Returns
    -------
    CoupledContact

    Raises
    ------
    RuntimeError
        If the coupled contact does not become steady, with the speed.
    """
    from compact.engines.pore_air.coupled_rolling import roll_coupled

    try:
        return roll_coupled(contact, air, speed, start=start)
    except RuntimeError as error:
        words = 'roll slower, or set mix.pore_air = "one-way"'
        raise RuntimeError(f"with pore air at {speed:.4g} m/s: {error}; {words}") from error


def coupled_samples(
    contact: Any, air: PoreAir, curve: AirCurve, speeds: Iterable[float], count: Callable[[str], None]
) -> Iterator[CoupledSample]:
    """Yield coupled contacts at ascending speeds, each from the one before.

    Parameters
    ----------
    contact : Contact
        Contact without air.
    air : PoreAir
        Pore air.
    curve : AirCurve
        Curve at the deformation without air.
    speeds : iterable of float
        Speeds [m/s], ascending.
    count : callable
        Called with "coupled" before each contact.

    Yields
    ------
    CoupledSample

    Raises
    ------
    RuntimeError
        If a coupled contact does not become steady, with the speed.
    """
    start: CoupledContact | None = None
    for speed in speeds:
        count("coupled")
        start = coupled_contact(contact, air, speed, start)
        alone = curve.at(speed, air.permeability)
        load, resistance, _ = start.changes
        yield CoupledSample(abs(speed) / air.permeability, load / alone.load, resistance / alone.resistance)


def add_air_field(mesh: Any, result: Any, air: PoreAir) -> None:
    """Add the excess pressure of the air at the deformation without air to a mesh with fields, as cell data.

    Parameters
    ----------
    mesh : meshio.Mesh
        Mesh of `engines.compaction.engine.field_mesh`.
    result : Contact
        Its contact.
    air : PoreAir
        Pore air.
    """
    from compact.engines.pore_air.steady_flow import RollerAir

    under = RollerAir(result.solution, air)
    under.add_field(mesh, under.pressure(result.speed))
