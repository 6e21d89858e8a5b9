"""Interface of the contact engines: the object that each of them is, its case, and the values of scene keys it takes.

Nothing heavy is imported here, nor by the packages of the engines: they import their numerics inside the methods.
Another package adds an engine by an entry point of the group "compact.engines" that names an `Engine`:

    [project.entry-points."compact.engines"]
    winkler = "my_package.registration:WINKLER"

A scene then accepts `accuracy.engine = "winkler"`.
"""

import reprlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

from compact.numerics.validation import require_known
from compact.rolling_contact import BaseCondition, Contact, GapGeometry, Layer, Roller, RollerCondition, require_moving

if TYPE_CHECKING:  # scipy is imported where a resistance is sampled
    from compact.resistance import ForceSample, ResistanceExpansion, ResistanceMap
    from compact.turning import Share

# shares of the force and of the load over the travel since a turn, of the distance D to fresh mix [m]
Turning = Callable[[float], "tuple[Share, Share]"]
Takes = Literal["half-plane", "linear layer", "compacting layer", "process"]
SPEED_SHARES = tuple(2.0**power for power in range(-4, 2))  # [-], of the mean speed; default speeds of the contacts
AFFORDABLE = 0.1  # [s], processor time of a contact of which hundreds may be computed, as a sensitivity needs
VISCOELASTIC, FLOOR = "viscoelastic part only", "confined floor"  # reasons against an engine that sizes a drive
LINEAR = ("required_pressure", "effective_modulus", "poisson", "instant_over_relaxed", "relaxation_time")
PLASTIC = (
    "heckel_slope", "unloading_modulus", "poisson", "friction_angle", "cohesion", "saturation_limit",
    "rate_sensitivity",
)  # fmt: skip
FED_DENSITIES = ("layer.fed_density_ratio", "process.feed_density_ratio")
_LAYERED = ("contact.speeds", "contact.indentation")
OWN_KEYS: dict[str, tuple[str, ...]] = {  # kind of the cases -> keys and tables that not every engine reads
    "half-plane": (),
    "linear layer": _LAYERED,
    "compacting layer": (*_LAYERED, "layer.fed_density_ratio", "mix.pore_air"),
    "process": (*_LAYERED, "process.feed_density_ratio", "process"),
}
_OF_ELLIPSE, _OF_LINE = ("cohesion",), ("cohesion_loose", "dilatancy_angle", "shear_viscosity")
_OF_AIR = ("air_permeability", "occlusion_saturation")


def shares_of(kind: str, *shape: float, **film: float | None) -> Turning:
    """Return the shares of force and load of a contact, a "wave" or an "imprint" of a shape, see `compact.turning`."""
    from compact import turning

    return partial(getattr(turning, f"{kind}_shares"), *shape, **film)


@dataclass(frozen=True)
class Limit:
    """Values of one key that an engine accepts.

    Parameters
    ----------
    taken : tuple
        Accepted values; the first replaces all others.
    why : str
        Reason, as a clause for messages.
    smooth : tuple
        Values accepted only without friction between mix and roller.
    fixed : bool
        True if the engine replaces the value even of a key that the scene sets.
    late : bool
        True if a value is refused only when the contact is computed, because several engines share the scene.
    """

    key: str
    taken: tuple
    why: str
    smooth: tuple = ()
    fixed: bool = False
    late: bool = False

    def value_in(self, scene: Any) -> Any:
        """Return the value of the key in a scene; None where its table is absent."""
        table, key = self.key.split(".")
        return getattr(getattr(scene, table), key, None)

    def takes(self, value: object, friction: float | None) -> bool:
        """Return True if the engine accepts a value.

        Parameters
        ----------
        friction : float or None
            Friction coefficient of the mix on the roller [-]; None for the prior.
        """
        return value in self.taken or (value in self.smooth and friction == 0)


ONE_MODULUS = Limit("layer.plies", (None,), "it has one modulus for the whole layer")
ONE_MIX = Limit("layer.plies", (None,), "its layer is of one mix")
RIGID_BASE = Limit("layer.lower_lift", (None,), "its layer does not compact, and lies on a rigid base")
NO_AIR = Limit("mix.pore_air", ("drained",), "its layer has no voids that close", fixed=True)
RECOVERS = (
    Limit("layer.passes", (1,), "an elastic layer keeps no trace of a pass"),
    Limit("layer.return_stroke", ("fresh",), "it compacts no mix that the return stroke could roll over"),
)


@dataclass(frozen=True, kw_only=True)
class Case:
    """Contact of one roller with a layer at one speed.

    Parameters
    ----------
    layer : Layer
        Layer before the pass.
    roller : Roller
        Roller with the prescribed quantity.
    material : Elastic, Viscoelastic or Compaction
        Law of the mix: of a half-plane, of a linear layer, of a compacting layer.
    speed : float
        Speed of the roller [m/s].
    tolerance : float, optional
        Relative tolerance [-], of engines with error control; their own by default.
    estimate : bool
        False to omit the error estimate where it costs.
    exit_density_ratio : float, optional
        Density ratio behind the roller that replaces the target of the roller [-]; its indentation is a first guess.
    torque : float, optional
        Torque per unit roller length [N], of engines that read `machine.roller_torque`.
    factors : mapping
        Factors of eqs 1.6 and 1.8: rolling friction, nonuniformity of the pressure, one-sided contact.
    unlimited : bool
        True to compute a contact that an estimate of heaping would refuse.
    numerics : mapping
        Numerical options of an engine with several of them.
    progress : callable, optional
        Called with lines of text by slow engines.
    """

    layer: Layer
    roller: Roller
    material: Any
    speed: float
    tolerance: float | None = None
    estimate: bool = True
    exit_density_ratio: float | None = None
    torque: float | None = None
    factors: Mapping[str, Any] = field(default_factory=dict)
    unlimited: bool = False
    numerics: Mapping[str, Any] = field(default_factory=dict)
    progress: Callable[[str], None] | None = None

    def within(self, keyword: str) -> dict[str, Any]:
        """Return the tolerance as a keyword of an engine; nothing for its default."""
        return {} if self.tolerance is None else {keyword: self.tolerance}


class Engine:
    """Contact engine; another package subclasses it, sets the attributes and defines `contact`.

    Attributes
    ----------
    takes : {"half-plane", "linear layer", "compacting layer", "process"}
        Kind of its cases: an elastic half-plane without speed, a viscoelastic layer, a layer with irreversible
        compaction, or all strokes of a forming process.
    mix_parameters : tuple of str
        Parameters of the mix that the contact depends on.
    fed_key : str
        Key of the initial density ratio.
    limits : tuple of Limit
        Values of scene keys that it takes.
    optional_keys : tuple of str
        Keys that it reads and other engines do not.
    speed_shares : tuple of float
        Default speeds of the contacts over the mean speed [-].
    cost : float
        Processor time of one contact of the published machine on one core of 2026 [s].
    points_per_task : int
        Points of a sweep in one task, for about a tenth of a second of work.
    line : int
        Neighbouring points of a sweep, each of which starts from the one before; 1 where no contact is a start.
    low_fidelity : str or None
        Engine that a sweep computes at every point, corrected by this one at some of them.
    turning_error : float or None
        Largest relative error of peaks behind a spring by `turning` [-]; None where no history of forces supports it.
    """

    name: str
    takes: Takes
    mix_parameters: tuple[str, ...] = ()
    fed_key: str = "layer.fed_density_ratio"
    limits: tuple[Limit, ...] = ()
    optional_keys: tuple[str, ...] = ()
    speed_shares: tuple[float, ...] = SPEED_SHARES
    cost: float = 0.01
    points_per_task: int = 1
    line: int = 1
    low_fidelity: str | None = None
    turning_error: float | None = None

    def require(self, layer: Layer | None, roller: Roller, speed: float) -> None:
        """Require a roller in motion, and conditions of layer and roller within the limits; ValueError otherwise.

        Parameters
        ----------
        layer : Layer or None
            Layer; None of a pass over mix that an earlier one has left behind.
        roller : Roller
            Roller; a fixed limit, which replaces a value of the scene, refuses none.
        speed : float
            Speed of the roller [m/s].
        """
        require_moving(speed)
        require_known("rolling", roller.rolling, get_args(RollerCondition))
        require_known("profile", roller.profile, get_args(GapGeometry))
        if layer is not None:
            require_known("base", layer.base, get_args(BaseCondition))
        names = {"machine.roller_condition": "rolling", "machine.gap_geometry": "profile"}
        for limit in self.limits:
            table, key = limit.key.split(".")
            name = names.get(limit.key, key)
            value = getattr(layer if table == "layer" else roller, name, None) or None
            if not (limit.fixed or value is None or limit.takes(value, roller.friction)):
                friction = f" with `friction` {roller.friction:g}" if limit.smooth else ""
                got = f"{reprlib.repr(value)}{friction}"
                raise ValueError(f"the engine {self.name} takes no `{name}` {got}, as {limit.why}")

    def contact(self, case: Any, start: Any = None) -> Contact:
        """Compute a contact.

        Parameters
        ----------
        case : Case
            Layer, roller, material and speed.
        start : Contact, optional
            Any contact of the engine, used as initial guess where it serves.
        """
        raise NotImplementedError(f"the engine {self.name} computes no contact")

    def valid(self, height_ratio: float | None = None, detail: str | None = None) -> str:
        """State why the engine may not size a drive.

        Parameters
        ----------
        height_ratio : float, optional
            Height of the layer over the contact length [-].
        detail : str, optional
            Detail of the forming process, of an engine of its strokes.

        Returns
        -------
        str
            Reason with the number that decides; empty if it may.
        """
        return VISCOELASTIC if self.takes == "linear layer" else ""

    @property
    def fitted_keys(self) -> tuple[str, ...]:
        """Keys of the scene, beyond the mix, that a fit to measurements may change."""
        return FED_DENSITIES if self.reads(self.fed_key) else ()

    @property
    def affordable(self) -> bool:
        """True if hundreds of contacts may be computed."""
        return self.cost < AFFORDABLE

    def reads(self, key: str) -> bool:
        """Return True for a key or table that not every engine reads, such as "contact.speeds", but this one."""
        return key in (*self.optional_keys, *OWN_KEYS[self.takes])

    def pick(self, by_kind: Mapping[str, Any]) -> Any:
        """Return the entry for the kind of its cases, such as the law of the mix."""
        return by_kind[self.takes]

    def parameters_of(self, law: str, air: bool = False) -> tuple[str, ...]:
        """Return the parameters of the mix with independent spreads that a contact depends on.

        Parameters
        ----------
        law : {"ellipse", "drucker-prager-cap"}
            Yield surface of the mix. The earth pressure coefficient follows from the friction angle.
        air : bool
            True with those of the pore air, if the layer has voids that close.
        """
        if not self.reads(self.fed_key):
            return self.mix_parameters
        names = self.mix_parameters
        if law != "ellipse":
            names = (*(name for name in names if name not in _OF_ELLIPSE), *_OF_LINE)
        return (*names, *_OF_AIR) if air else names

    def target(self, case: Case) -> tuple[str, float]:
        """Return name and value of the quantity that the contact reaches."""
        return case.roller.target

    def equal(self, case: Case, known: Any) -> bool:
        """Return True if a known contact differs from a case by its speed alone, on which the forces do not depend."""
        return False

    def as_start(self, contact: Contact | None) -> Contact | None:
        """Return a contact if it can be the start of another one, else None."""
        return None

    def roll_over(self, state: Any, case: Case) -> Contact:
        """Compute a pass over mix that an earlier pass has left behind; `state` None is fresh mix.

        Raises
        ------
        ValueError
            If the engine computes no such passes.
        """
        raise ValueError(f"the engine {self.name} computes one pass alone; choose column or compaction")

    def expand(self, case: Case) -> "ResistanceExpansion | None":
        """Expand the resistance to first order in the acceleration; None where the mix has no memory in time."""
        return None

    def turning(self, contact: Contact, radius: float, release: float, film: float | None = None) -> Turning | None:
        """Return the shares of force and load after a turn of the cart; None where their transient is unknown: a step.

        Parameters
        ----------
        contact : Contact
            Steady contact of the engine, or its record.
        radius : float
            Radius of the roller [m].
        release : float
            Length over which the old force lets go [m], `turning.elastic_release`.
        film : float, optional
            Thickness of loose mix on a pressed lower lift [m]; None on a rigid base.
        """
        return None

    def fields(self, contact: Any) -> Any:
        """Return a mesh with the fields inside the layer; None for an engine without them."""
        return None

    @property
    def rolls_over(self) -> bool:
        """True if the engine computes passes over mix that an earlier pass has compacted."""
        return type(self).roll_over is not Engine.roll_over

    @property
    def has_fields(self) -> bool:
        """True if the engine computes fields inside the layer."""
        return type(self).fields is not Engine.fields

    def noise(self, contact: Any) -> float:
        """Estimate the relative scatter of the resistance between contacts at neighbouring speeds [-].

        It is the part of the error that depends on the way to the steady state; the error by the mesh is common to the
        contacts.
        """
        return 0.0

    def first_samples(self, rolled: list[Any], reference: Any) -> list[Any]:
        """Return the contacts, each with its speed, with which a map of the resistance begins.

        Parameters
        ----------
        rolled : list of (float, Contact)
            Contacts at the speeds of the scene [m/s].
        reference : (float, Contact) or None
            Contact at the mean speed, if it has been computed.
        """
        return [*rolled]

    def sample(
        self,
        resistance: Callable[[float], "ForceSample"],
        rate_factor: Callable[[], Callable[[float], float]],
        slowest: float,
        fastest: float,
        tolerance: float,
        known: Iterable["ForceSample"] = (),
    ) -> "ResistanceMap":
        """Sample the resistance over the speed.

        Parameters
        ----------
        resistance : callable
            Contact at a speed [m/s].
        rate_factor : callable
            Returns the factor of the yield pressure [-] as a function of the speed [m/s].
        slowest, fastest : float
            Range of speeds [m/s].
        tolerance : float
            Largest relative error [-].
        known : iterable of ForceSample
            Contacts that exist already.
        """
        from compact.resistance import sample_resistance

        pairs = [each[:3] for each in known]
        return sample_resistance(lambda speed: resistance(speed)[1:3], slowest, fastest, tolerance, pairs)

    @property
    def source(self) -> str:
        """Checksum of the sources of an engine of another package; those of this package are part of its `versions`."""
        module = type(self).__module__
        if module.startswith("compact."):
            return ""
        from compact.files import checksum
        from compact.numerics.jit import source_files

        import_module(module)
        return checksum(b"".join(Path(file).read_bytes() for file in sorted(source_files(module))))


class RateEngine(Engine):
    """Engine whose resistance depends on the speed by the rate factor of the yield pressure alone.

    Its contacts scatter and cost too much for a map without this law, see `rate_law`.
    """

    speed_shares = (1 / 16, 1.0)

    def first_samples(self, rolled: list[Any], reference: Any) -> list[Any]:
        """Return the contacts of the scene, and that at the mean speed, each of which is expensive."""
        return [*rolled, *([] if reference is None or reference[0] in dict(rolled) else [reference])]

    def sample(
        self,
        resistance: Callable[[float], "ForceSample"],
        rate_factor: Callable[[], Callable[[float], float]],
        *given: Any,
    ) -> "ResistanceMap":
        """Sample the law of the resistance over the rate factor."""
        from compact.engines.rate_law import sample_rate_law

        return sample_rate_law(resistance, rate_factor(), *given)
