"""Registry of the contact engines: the module of each and its declared capabilities.

Every engine is a module with `roll(layer, roller, material, speed) -> ContactResult`, imported on first use. The engine
"process" has all strokes of a scene in place of one pass, and `analysis.process_contact` computes them. No other module
of the package has a table of engines, except `scene.engine_capabilities` for the values of scene keys.

Other packages add engines by entry points of the group "compact.engines", each of which names an `Engine`:

    [project.entry-points."compact.engines"]
    winkler = "my_package.registration:WINKLER"

A scene then accepts `accuracy.engine = "winkler"`. The engine receives `Layer`, `Roller` and a material law of the mix:
`Compaction` if it is `compacting`, else `Viscoelastic`, or `Elastic` if it is not `layered`.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from compact.files import checksum
from compact.material.laws import Elastic, Viscoelastic
from compact.numerics.validation import require_known
from compact.resistance import ResistanceExpansion
from compact.rolling_contact import ContactResult, Layer, Roller
from compact.scene.engine_capabilities import ENTRY_POINTS, TORQUE_ENGINES, installed_engines
from compact.scene.loader import Scene

ProcessDetail = Literal["columns", "quick", "deep"]

_LINEAR = ("required_pressure", "effective_modulus", "poisson", "instant_over_relaxed", "relaxation_time")
_PLASTIC = ("heckel_slope", "unloading_modulus", "poisson", "friction_angle", "cohesion", "rate_sensitivity")


_OF_ELLIPSE, _OF_LINE = ("cohesion",), ("cohesion_loose", "dilatancy_angle", "shear_viscosity")


@dataclass(frozen=True)
class Engine:
    """Capabilities of one contact engine.

    Parameters
    ----------
    seconds : float
        Processor time of one contact of the published machine on one core of 2026 [s].
    mix_parameters : tuple of str
        Parameters of the mix that the contact depends on.
    layered : bool
        True for a layer of finite height, whose resistance depends on the speed; False for a half-plane.
    compacting : bool
        True for irreversible compaction, False for a linear layer.
    forming : bool
        True for all strokes of the forming process of a scene, in place of one pass over a layer.
    continuation : bool
        True if the contact at another speed is a valid initial guess.
    density_target : bool
        True if `roll` iterates to a prescribed exit density ratio.
    rate_factor_only : bool
        True if the speed enters through `Compaction.rate_factor` alone, and contacts scatter and cost too much for a
        map without this law: ln F is then a smooth function of the logarithm of the factor.
    cheap : bool
        True if the sensitivity analysis may compute new contacts.
    tolerance_keyword : str or None
        Keyword of `roll` for the relative tolerance; None where the engine has no error control.
    optional_estimate : bool
        True if `roll` accepts `estimate=False`, which omits the error estimate.
    fields_module : str or None
        Module with the function `field_mesh`; None without fields inside the layer.
    derivative_module : str or None
        Module with the function `expand_resistance`, the derivative of the resistance with respect to the speed; None
        without.
    points_per_task : int
        Points of a sweep in one task, for about a tenth of a second of work.
    low_fidelity : str or None
        Engine that a sweep computes at every point, corrected by this one at some of them; None if this one computes
        every point.
    """

    name: str
    module: str
    seconds: float
    mix_parameters: tuple[str, ...]
    layered: bool = True
    compacting: bool = False
    forming: bool = False
    continuation: bool = False
    density_target: bool = False
    rate_factor_only: bool = False
    cheap: bool = True
    tolerance_keyword: str | None = None
    optional_estimate: bool = False
    fields_module: str | None = None
    derivative_module: str | None = None
    points_per_task: int = 1
    low_fidelity: str | None = None

    def parameters_of(self, law: str) -> tuple[str, ...]:
        """Return the parameters of the mix with independent spreads that a contact depends on.

        Parameters
        ----------
        law : {"ellipse", "drucker-prager-cap"}
            Yield surface of the mix. The earth pressure coefficient follows from the friction angle.
        """
        if not self.compacting or law == "ellipse":
            return self.mix_parameters
        return (*(name for name in self.mix_parameters if name not in _OF_ELLIPSE), *_OF_LINE)

    @property
    def sizing(self) -> bool:
        """True if the engine has the whole resistance and may size a drive; a linear layer has a part of it alone."""
        return self.compacting or not self.layered

    @property
    def multipass(self) -> bool:
        """True if it computes passes over mix that an earlier pass has compacted."""
        return self.compacting and not self.forming and self.name in _BUILT_IN

    @property
    def torque(self) -> bool:
        """True if the roller may stick and slip under a torque."""
        return self.name in TORQUE_ENGINES

    @property
    def roll(self) -> Callable[..., ContactResult]:
        """The function `roll` of the engine."""
        return import_module(self.module).roll

    @property
    def source(self) -> str:
        """Checksum of the sources of an engine of another package; those of this package are part of its `versions`."""
        if self.name in _BUILT_IN:
            return ""
        from compact.numerics.jit import source_files

        import_module(self.module)
        return checksum(b"".join(Path(file).read_bytes() for file in sorted(source_files(self.module))))

    def fields(self, result: ContactResult) -> Any:
        """Compute the fields inside the layer."""
        require_known("engine with fields", self.name, [each.name for each in ENGINES.values() if each.fields_module])
        return import_module(str(self.fields_module)).field_mesh(result)

    def noise(self, result: ContactResult) -> float:
        """Estimate the relative scatter of the resistance between contacts at neighbouring speeds [-].

        It is the part of the error that depends on the way to the steady state; the error by the mesh is common to the
        contacts. It is 0 for an engine without such parts.
        """
        parts = getattr(result, "error_parts", None)
        return 0.0 if parts is None else float(parts.drift[1] + parts.start[1])

    def tolerance(self, value: float, estimate: bool = True) -> dict[str, Any]:
        """Return the keyword arguments of `roll` for a relative tolerance [-], and without an error estimate."""
        options: dict[str, Any] = {self.tolerance_keyword: value} if self.tolerance_keyword else {}
        return options if estimate or not self.optional_estimate else options | {"estimate": False}


_BUILT_IN: Mapping[str, Engine] = MappingProxyType({
    each.name: each
    for each in (
        Engine(
            "formula", "compact.engines.formula",
            0.001,
            ("required_pressure", "effective_modulus", "poisson", "steel_friction"),
            layered=False, points_per_task=100,
        ),
        Engine(
            "column", "compact.engines.column.engine",
            0.03,
            _PLASTIC,
            compacting=True, points_per_task=100,
        ),
        Engine(
            "spectral", "compact.engines.spectral.engine",
            0.02,
            _LINEAR,
            tolerance_keyword="rtol", derivative_module="compact.engines.spectral.speed_derivative", points_per_task=5,
        ),
        Engine(
            "fem", "compact.engines.fem.engine",
            0.55,
            (*_LINEAR, "steel_friction"),
            tolerance_keyword="tolerance", optional_estimate=True, cheap=False,
            fields_module="compact.engines.fem.fields", derivative_module="compact.engines.fem.speed_derivative",
        ),
        Engine(
            "compaction", "compact.engines.compaction.engine",
            8.0,
            (*_PLASTIC, "steel_friction"),
            compacting=True, continuation=True, density_target=True, rate_factor_only=True, cheap=False,
            points_per_task=8,
            fields_module="compact.engines.compaction.engine", low_fidelity="column",
        ),
        Engine(
            "process", "compact.analysis.process_contact",
            0.4,
            (*_PLASTIC, "steel_friction"),
            compacting=True, forming=True, rate_factor_only=True, cheap=False,
        ),
    )
})  # fmt: skip


class _Registry(Mapping[str, Engine]):
    """Engines of this package, then those of other packages; the latter are loaded when first used."""

    def __getitem__(self, name: str) -> Engine:
        return _BUILT_IN.get(name) or _load_engine(name)

    def __iter__(self) -> Iterator[str]:
        return iter((*_BUILT_IN, *(name for name in installed_engines() if name not in _BUILT_IN)))

    def __len__(self) -> int:
        return len(list(iter(self)))


def _load_engine(name: str) -> Engine:
    for entry in entry_points(group=ENTRY_POINTS, name=name):
        engine = entry.load()
        if not isinstance(engine, Engine) or engine.name != name:
            raise ValueError(
                f"the entry point {name} of the group {ENTRY_POINTS} must be an Engine called {name!r}, got {engine!r}"
            )
        return engine
    raise KeyError(name)


ENGINES: Mapping[str, Engine] = _Registry()


def process_detail(scene: Scene) -> ProcessDetail:
    """Return the detail of the forming process of a scene by the engine "process", lumped lifts by default."""
    return (scene.process and scene.process.detail) or "quick"


def has_whole_resistance(scene: Scene) -> bool:
    """Return True if the engine of a scene has the whole resistance; columns have the confined floor of a process."""
    engine = ENGINES[scene.accuracy.engine]
    return engine.sizing and not (engine.forming and process_detail(scene) == "columns")


def expand_resistance(
    layer: Layer,
    roller: Roller,
    material: Elastic | Viscoelastic,
    speed: float,
    engine: str = "spectral",
    **accuracy: Any,
) -> ResistanceExpansion:
    """Expand the resistance of a linear layer to first order in the acceleration, `F(v) + a M(v)`.

    Parameters
    ----------
    speed : float
        Speed of the roller [m/s].
    **accuracy
        Keywords of the engine: "spectral" takes `rtol`; "fem" takes `mesh`, `tolerance`, `estimate`.

    Examples
    --------
    >>> from compact.material.laws import Viscoelastic
    >>> from compact.rolling_contact import Layer, Roller
    >>> mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
    >>> found = expand_resistance(Layer(0.22), Roller(0.11, indentation=0.003), mix, speed=0.05)
    >>> f"{found.resistance:.2f} N/m, {found.slope:.1f} N s/m2, {found.added_mass:.3f} N s2/m2"
    '376.42 N/m, 2937.5 N s/m2, -37.732 N s2/m2'
    """
    able = [each.name for each in ENGINES.values() if each.derivative_module]
    require_known("engine with memory in time", engine, able)
    return import_module(str(ENGINES[engine].derivative_module)).expand_resistance(
        layer, roller, material, speed, **accuracy
    )
