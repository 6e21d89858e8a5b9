"""Common interface of the contact engines: layer with its plies and a lift below, roller, results of steady rolling.

All engines share one call, `engine.roll(layer, roller, material, speed)`. The x axis points along the travel and y
upwards; the base is at y = 0. Quantities are per unit roller length, in SI units.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from itertools import accumulate
from typing import Any, Literal, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.validation import require_fields, require_finite, require_inside, require_positive, require_that
from compact.quantities import CONTACT, PASS

BaseCondition = Literal["bonded", "slip"]

HEIGHT_TOLERANCE = 1e-9  # [-], of the layer height; rounding of decimal thicknesses


@dataclass(frozen=True, kw_only=True)
class Ply:
    """Ply of a layer.

    Parameters
    ----------
    thickness : float
        Thickness [m], > 0.
    stiffness : float
        Relative modulus: moduli of the ply over those of the material [-], > 0.
    """

    thickness: float
    stiffness: float

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness, stiffness=self.stiffness)


@dataclass(frozen=True, kw_only=True)
class LowerLift:
    """Lift below the fed one, of the same mix, compacted by an earlier pass and bonded to it.

    Parameters
    ----------
    thickness : float
        Thickness at rest [m], > 0.
    density_ratio : float
        Density ratio k at rest [-], 0 < k < 1; at the same time that of its preconsolidation.
    residual_stress : bool
        True for the lateral stress that confined compression leaves behind, False for mix without stress.
    """

    thickness: float
    density_ratio: float
    residual_stress: bool = True

    def __post_init__(self) -> None:
        require_positive(thickness=self.thickness)
        require_inside(0, 1, density_ratio=self.density_ratio)

    def compaction_rate(self, speed: float, radius: float, fed_density_ratio: float) -> float:
        """Compute the rate of compaction in the earlier pass [1/s], see `compaction_rate`.

        Parameters
        ----------
        speed, radius : float
            Speed [m/s] and radius [m] of the roller.
        fed_density_ratio : float
            Initial density ratio of the mix [-].
        """
        fed_height = self.thickness * self.density_ratio / fed_density_ratio
        return compaction_rate(speed, radius, fed_height, fed_height - self.thickness)


@dataclass(frozen=True)
class Layer:
    """Layer on a rigid base, of one material or of plies, or lift of mix on a lower lift.

        E(y, t) = c(y) E(t),  c the relative modulus of the ply at y

    The plies are bonded to one another and share Poisson's ratio and the relaxation spectrum of the material.

    Parameters
    ----------
    height : float
        Height H [m], > 0; that of the mix as fed where it compacts.
    base : {"bonded", "slip"}
        Bonded or frictionless base.
    plies : tuple of Ply
        Plies from the base upwards; without plies the layer has the relative modulus 1.
    lower_lift : LowerLift, optional
        Lift between the layer and the base, under mix that compacts; the height does not contain it.

    Raises
    ------
    ValueError
        If the thicknesses do not add up to the height, or a layer with a lower lift has plies.
    """

    height: float
    _: KW_ONLY
    base: BaseCondition = "bonded"
    plies: tuple[Ply, ...] = ()
    lower_lift: LowerLift | None = None

    def __post_init__(self) -> None:
        require_positive(height=self.height)
        object.__setattr__(self, "plies", tuple(self.plies))
        total = sum(ply.thickness for ply in self.plies)
        rule = f"the thicknesses of `plies` must add up to the layer height, {self.height!r} m, got"
        require_that(not self.plies or abs(total - self.height) <= HEIGHT_TOLERANCE * self.height, total, rule)
        alone = not self.plies or self.lower_lift is None
        require_that(alone, len(self.plies), "a layer with a `lower_lift` has no `plies`, got")

    @cached_property
    def stack(self) -> tuple[Ply, ...]:
        """Plies from the base upwards, at least one."""
        return self.plies or (Ply(thickness=self.height, stiffness=1.0),)

    @property
    def top(self) -> Ply:
        """Ply in contact with the roller."""
        return self.stack[-1]

    @cached_property
    def interfaces(self) -> tuple[float, ...]:
        """Heights of the interfaces between plies [m], ascending."""
        return tuple(accumulate(ply.thickness for ply in self.stack[:-1]))

    def stiffness(self, y: ArrayLike) -> Array:
        """Return the relative modulus c [-] at heights y [m] off the interfaces."""
        return np.array([ply.stiffness for ply in self.stack])[np.searchsorted(self.interfaces, y)]


def compaction_rate(speed: float, radius: float, fed_height: float, depth: float) -> float:
    """Compute the mean rate of compaction under a roller [1/s].

        rate = |v| ln(k_out/k_in)/a,    k_out/k_in = H/(H - d),    a = sqrt(2 R d)

    Density ratio and contact length are nominal: those of mix that is pressed from its height as fed to the lowest
    generatrix without elastic recovery, and of a rigid parabola in a plane. The rate is thus an explicit function of
    speed and geometry for every engine. Mix that an earlier pass has compacted counts as fed, so that a second pass at
    the same height has the rate of the first.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    radius : float
        Roller radius R [m].
    fed_height : float
        Height H of all mix below the roller at its initial density ratio [m].
    depth : float
        Depth d of the lowest generatrix below that height [m], less than H; 0 is the rate of a touching roller.

    Examples
    --------
    >>> f"{compaction_rate(0.13, 0.11, 0.063, 0.003):.3f} 1/s"
    '0.247 1/s'
    """
    if depth <= 0:
        return 0.0
    return float(-abs(speed) * np.log1p(-depth / fed_height) / np.sqrt(2 * radius * depth))


RollerCondition = Literal["frictionless", "sliding", "free", "driven"]
GapGeometry = Literal["parabola", "circle", "deformed"]

Number = Any  # a float, or None of an engine that does not have it
NOTHING = np.empty(0)  # of a contact without a profile
COMPACTED = (  # numbers of engines with irreversible compaction only
    "bow_wave", "exit_density_ratio", "exit_height", "lower_height", "lower_density_ratio", "peak_density_ratio",
    "peak_loaded_density_ratio", "overdense_work", "overfull_share", "density_reset", "mass_residual",
    "yield_residual", "equilibrium_residual", "air_load", "air_resistance", "air_excess_behind",
)  # fmt: skip
COMMON = tuple(name for name in CONTACT if name not in COMPACTED)
MIN_RESISTANCE_RATIO = 1e-3  # [-], of the load; relative errors of smaller resistances refer to it, theory.md 3.1


@dataclass(frozen=True)
class Roller:
    """Rigid roller with one prescribed contact quantity; the engine computes the others.

    Parameters
    ----------
    radius : float
        Radius R [m], > 0.
    indentation : float, optional
        Indentation [m], > 0.
    friction : float
        Friction coefficient mu of mix on roller [-], >= 0.
    rolling : {"frictionless", "sliding", "free", "driven"}
        Traction on the mix: none, along the travel, zero in sum, or against the travel. The engines "formula" and
        "spectral" treat "driven" as full slip; "fem" and "compaction" solve stick and slip of a free or driven roller
        under a torque.
    profile : {"parabola", "circle", "deformed"}
        Gap vertical to the parabola or to the circle, or normal to the circle on the deformed surface.
    load : float, optional
        Load P per unit roller length [N/m], > 0.
    peak_pressure : float, optional
        Peak pressure p0 [Pa], > 0.

    Raises
    ------
    ValueError
        Unless exactly one of `indentation`, `load` and `peak_pressure` is set.
    """

    radius: float
    _: KW_ONLY
    indentation: float | None = None
    friction: float = 0.0
    rolling: RollerCondition = "frictionless"
    profile: GapGeometry = "parabola"
    load: float | None = None
    peak_pressure: float | None = None

    def __post_init__(self) -> None:
        require_fields(self, positive="radius", nonnegative="friction")
        prescribed = self._prescribed
        rule = "exactly one of `indentation`, `load`, `peak_pressure` must be set, got"
        require_that(len(prescribed) == 1, sorted(prescribed), rule)
        require_positive(**prescribed)

    @property
    def target(self) -> tuple[str, float]:
        """Name and value of the prescribed quantity."""
        return next(iter(self._prescribed.items()))

    @property
    def _prescribed(self) -> dict[str, float]:
        targets = {name: getattr(self, name) for name in ("indentation", "load", "peak_pressure")}
        return {name: value for name, value in targets.items() if value is not None}


class PrescribedMotion(Protocol):
    """Motion of the roller; its `discontinuities` and `legs`, where present, end time steps."""

    duration: float

    def position(self, time: Array) -> Array:
        """Return the position [m] at times [s]."""

    def velocity(self, time: Array) -> Array:
        """Return the velocity [m/s] at times [s]."""


def resistance_scale(resistance: float, load: float) -> float:
    """Return the force [N/m] to which relative errors of a resistance refer: its own, or a small share of the load."""
    return max(abs(resistance), MIN_RESISTANCE_RATIO * load)


def require_moving(speed: float) -> None:
    """Require a roller at a finite speed [m/s] other than 0."""
    require_finite(speed=speed)
    if speed == 0:
        raise ValueError(
            "`speed` must not be 0, got 0: the resistance at rest is set-valued; use a small speed with the sign of "
            "the travel"
        )


def require_torque_allowed(roller: Roller, torque: float | None) -> None:
    """Require a torque [N] only for a free or driven roller with friction, and always for a driven one."""
    turns = roller.rolling in ("free", "driven")
    if torque is not None:
        require_finite(torque=torque)
        if torque and not (turns and roller.friction > 0):
            raise ValueError(
                f"`torque` needs a roller that is 'free' or 'driven' and has `friction`, got {torque!r} for "
                f"'{roller.rolling}' with {roller.friction!r}"
            )
    elif roller.rolling == "driven":
        raise ValueError("`torque` must be given for a 'driven' roller, got None; a 'free' one needs none")


def require_target_reached(
    name: str, prescribed: float, reached: float, tolerance: float, scale: float | None = None
) -> None:
    """Require a prescribed quantity to be reached within a tolerance [-] of a scale, |prescribed| by default."""
    scale = abs(prescribed) if scale is None else scale
    if not abs(reached - prescribed) <= tolerance * scale:
        raise RuntimeError(
            f"`{name}` {prescribed:.9g} was prescribed and {reached:.9g} reached: relative error "
            f"{abs(reached - prescribed) / scale:.1e}, tolerance {tolerance:.0e}; the contact is discarded"
        )


def require_on_target(
    result: "Rolled",
    roller: Roller,
    tolerance: float,
    *,
    exit_density_ratio: float | None = None,
    torque: tuple[float, float] | None = None,
) -> "Rolled":
    """Return a contact, required to have the prescribed quantities; every engine calls this before it returns.

    An exit density ratio [-] is prescribed in place of the target of the roller. The tolerance [-] of prescribed and
    reached torque [N] is relative to the largest torque of friction.
    """
    name, prescribed = roller.target if exit_density_ratio is None else ("exit_density_ratio", exit_density_ratio)
    require_target_reached(name, prescribed, getattr(result, name), tolerance)
    if torque is not None:
        require_target_reached("torque", *torque, tolerance, roller.friction * result.load * roller.radius)
    return result


@dataclass(frozen=True)
class Heaping:
    """Contact without a steady state: the roller pushes the mix ahead in a growing bow wave.

    Parameters
    ----------
    depth : float or None
        Depth of the lowest generatrix below the surface of the layer [m]; None under a load that no depth bears.
    contact_angle : float
        Contact angle of the leading edge at the top of the bow wave [rad]; by the estimate its limit.
    wave_height : float or None
        Height of the bow wave above the surface of the layer where the computation ended [m]; None for the estimate.
    travel : float or None
        Travel of the roller until then [m]; None for the estimate.
    """

    depth: float | None
    contact_angle: float
    wave_height: float | None = None
    travel: float | None = None


class NoSteadyStateError(RuntimeError):
    """The contact has no steady state, or none was reached; its words are the first argument."""

    def __str__(self) -> str:
        return str(self.args[0])


class HeapingError(NoSteadyStateError):
    """Fresh mix would heap up, or heaps up, in front of the roller without a steady state.

    Parameters
    ----------
    message : str
        Reason, with remedies.
    heaping : Heaping
        Numbers of the contact.
    """

    heaping = property(lambda self: self.args[1], doc="Numbers of the contact.")


class EquilibriumError(RuntimeError):
    """No equilibrium was found; the message contains the smallest residual reached."""


@dataclass(frozen=True)
class Unsteady:
    """Contact that has not become steady within the largest travel, although its bow wave does not grow without end.

    Parameters
    ----------
    depth : float
        Depth of the lowest generatrix below the surface of the layer [m].
    wave_height : float
        Height of the bow wave above the surface of the layer [m].
    travel : float
        Travel of the roller [m].
    distance : float
        Estimated distance of load, resistance or exit density ratio from the steady state [-].
    load, resistance : float
        Last forces [N/m].
    """

    depth: float
    wave_height: float
    travel: float
    distance: float
    load: float
    resistance: float


class UnsteadyError(NoSteadyStateError):
    """The motion has not become steady within the largest travel.

    Parameters
    ----------
    message : str
        Reason, with remedies.
    unsteady : Unsteady
        Numbers of the contact.
    """

    unsteady = property(lambda self: self.args[1], doc="Numbers of the contact.")


@dataclass(frozen=True)
class Contact:
    """Steady contact of a roller with a layer, per unit roller length: the result of every engine, and its record.

    Numbers that an engine does not have are None. A record has the numbers alone: without arrays, case and solution.

    Parameters
    ----------
    load : float
        Normal force P [N/m].
    resistance : float
        Rolling resistance: minus the x-force of the mix on the roller [N/m]; odd in the speed.
    leading, trailing : float
        Contact edges from the lowest point of the roller, positive ahead [m].
    x, pressure, shear_traction : ndarray, shape (n,)
        Position along the contact [m], pressure, positive in compression, and shear traction [Pa].
    error : (float, float), optional
        Estimated relative errors of load and resistance [-]; None without an estimate.
    work_residual : float, optional
        Relative energy-balance residual of steady rolling [-]; None for an engine without fields.
    peak_pressure : float
        Peak pressure p0 between the samples too [Pa].
    history : tuple
        One row per iteration of the engine; empty for a closed form.
    engine : str
        Name of the engine, of a record.
    speed : float
        Speed of the roller along x [m/s].
    indentation : float, optional
        Depth of the lowest generatrix below the surface before the pass [m]; None on a half-plane.
    creep : float, optional
        Creepage, angular speed x radius/speed - 1, of a roller with stick and slip [-].
    bow_wave, exit_height, exit_density_ratio, lower_height, lower_density_ratio : float, optional
        Rise of the surface ahead above the fed layer [m]; height [m] and mean density ratio [-] of a compacting layer
        and of its lower lift behind the roller.
    peak_density_ratio, peak_loaded_density_ratio : float, optional
        Largest density ratio at rest of the layer, and under load of all mix, k exp(p/K) by the bulk modulus K [-].
    overdense_work : float, optional
        Share of the plastic work beyond the measured pressure curve, where the law of the mix extrapolates [-].
    overfull_share : float, optional
        Share of the section of the mix between the edges of the contact where k exp(p/K) > 1 [-].
    density_reset : float, optional
        Largest |ln| of the density by volume over the interpolated one as states move through the mesh by a step [-].
    mass_residual, yield_residual, equilibrium_residual : float, optional
        Relative residual of the mass balance, by finite elements the larger one of the exit and of all points, largest
        stress beyond the cap over its pressure, and relative residual of the forces [-].
    air_load, air_resistance, air_excess_behind : float, optional
        Load and resistance by the pore air [N/m], and its largest excess pressure behind [Pa]; of a record.
    passes : tuple of mapping
        Numbers of all passes by the names of `quantities.PASS`, of a record; empty for a linear layer.
    layer, roller, material : Layer, Roller, material law, optional
        Case, of an engine whose contacts are starts of others or have fields.
    exit : object
        State of the mix behind the roller, for the next pass; None for a linear layer.
    own : mapping of str to float
        Further numbers of the engine, such as the capture angle of the formulas.
    effort : str
        Words on the numerical effort; iterations by default.

    Raises
    ------
    RuntimeError
        If the roller has no contact or the resistance is not finite.
    """

    load: float
    resistance: float
    leading: float
    trailing: float
    x: Array = field(default_factory=NOTHING.copy)
    pressure: Array = field(default_factory=NOTHING.copy)
    shear_traction: Array = field(default_factory=NOTHING.copy)
    error: tuple[float, float] | None = None
    work_residual: float | None = None
    peak_pressure: float = np.nan
    history: tuple[Any, ...] = ()
    _: KW_ONLY
    engine: str = ""
    speed: float = np.nan
    indentation: Number = None
    creep: Number = None
    bow_wave: Number = None
    exit_height: Number = None
    exit_density_ratio: Number = None
    lower_height: Number = None
    lower_density_ratio: Number = None
    peak_density_ratio: Number = None
    peak_loaded_density_ratio: Number = None
    overdense_work: Number = None
    overfull_share: Number = None
    density_reset: Number = None
    mass_residual: Number = None
    yield_residual: Number = None
    equilibrium_residual: Number = None
    air_load: Number = None
    air_resistance: Number = None
    air_excess_behind: Number = None
    passes: tuple[Mapping[str, Number], ...] = ()
    layer: Any = None
    roller: Any = None
    material: Any = None
    exit: Any = None
    own: Mapping[str, float] = field(default_factory=dict)
    effort: str = ""

    def __post_init__(self) -> None:
        if not (0 < self.load < np.inf and self.trailing < self.leading):
            raise RuntimeError(
                f"the roller does not touch the layer: load {self.load:.3g} N/m, contact from {self.trailing:.3g} to "
                f"{self.leading:.3g} m; increase the indentation"
            )
        if not np.isfinite(self.resistance):
            raise RuntimeError(
                f"the resistance must be finite, got {self.resistance} N/m at a load of {self.load:.3g} N/m"
            )

    @property
    def contact_length(self) -> float:
        """Distance of the edges [m]."""
        return self.leading - self.trailing

    @property
    def coefficient(self) -> float:
        """Rolling-resistance coefficient, resistance over load [-]."""
        return self.resistance / self.load

    @property
    def load_error(self) -> float | None:
        """Estimated relative error of the load [-]."""
        return None if self.error is None else self.error[0]

    @property
    def resistance_error(self) -> float | None:
        """Estimated relative error of the resistance [-]."""
        return None if self.error is None else self.error[1]

    @property
    def iterations(self) -> int:
        """Number of iterations of the engine."""
        return len(self.history)

    def record(self, engine: str, speed: float, **numbers: Any) -> "Contact":
        """Return the numbers alone, in the direction of a speed [m/s], with others replaced."""
        known = {each.name: getattr(self, each.name) for each in fields(Contact)} | numbers
        bare: dict[str, Any] = dict.fromkeys(("x", "pressure", "shear_traction"), NOTHING)
        bare |= dict.fromkeys(("layer", "roller", "material", "exit")) | {"own": {}, "effort": ""}
        return Contact(**known | bare | {"engine": engine, "speed": speed, "history": (None,) * self.iterations})

    def to_json(self) -> dict[str, Any]:
        """Return nested dictionaries with "value", "unit" and, where there is one, "error", as in summary.json."""
        values = {name: getattr(self, name) for name in (*COMMON, *COMPACTED)}
        content: dict[str, Any] = {"engine": self.engine} | {name: _with_unit(name, values) for name in COMMON}
        content["load"]["error"], content["resistance"]["error"] = self.error or (None, None)
        content["iterations"] = self.iterations
        content |= {name: _with_unit(name, values) for name in COMPACTED if values[name] is not None}
        if self.passes:
            content["passes"] = [{name: _with_unit(name, each) for name in each} for each in self.passes]
        return content

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> Self:
        """Read a record back from the form of `to_json`.

        Raises
        ------
        KeyError, TypeError
            If `content` has another form.
        """
        values = {name: content[name]["value"] for name in (*COMMON, *COMPACTED) if name in COMMON or name in content}
        del values["coefficient"]
        error = (content["load"]["error"], content["resistance"]["error"])
        passes = ({name: each[name]["value"] for name in PASS} for each in content.get("passes", ()))
        return cls(
            **values, engine=content["engine"], history=(None,) * content["iterations"], passes=tuple(passes),
            error=None if None in error else error,
        )  # fmt: skip


def _with_unit(name, values):
    return {"value": values[name], "unit": CONTACT[name].unit}


ContactResult = Contact  # public name
Rolled = TypeVar("Rolled", bound=Contact)


def for_travel(contact: Rolled, speed: float) -> Rolled:
    """Express a contact along +x in the fixed axis x of a roller with a speed [m/s] of either sign.

    `leading` and `trailing` remain positive ahead; `x`, `shear_traction` and `resistance` change their sign.
    """
    if speed > 0:
        return contact
    x, pressure, shear_traction = -contact.x[::-1], contact.pressure[::-1], -contact.shear_traction[::-1]
    return replace(contact, resistance=-contact.resistance, x=x, pressure=pressure, shear_traction=shear_traction)
