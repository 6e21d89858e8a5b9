"""From moisture and density ratio of the mix to its parameters, each with its spread and its origin.

No publication gives these as functions of moisture W and density ratio k: `data/mix.csv` is a prior for a stiff
fine-grained mix, in which only the required pressure and the relaxed modulus at W 0.10, k 0.98 are tied to a published
machine. Whoever shows a number shows its spread. Between the nodes the table is interpolated, never beyond them.

The coordinate along k is u = -ln(1 - k), the one of Heckel's curve

    q = ln[(1 - k0)/(1 - k)] / K_H,    K_H = 13/MPa x factor(W),    k0 = 0.72,

on which the required pressure is a straight line and every power of 1 - k (pore air, plastic slope) a straight line of
its logarithm. All pressures and moduli scale as 1/L with the roller length L, which no source gives.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from compact.numerics.validation import require_between, require_known, require_nonnegative, require_positive

SOLIDS = 2650.0  # density of the grains [kg/m3]
WATER = 1000.0  # density of water [kg/m3]
LOOSE_DENSITY_RATIO = 0.72  # k0, where Heckel's curve starts [-]; a constant of the curve, not an allowed density
HECKEL_SLOPE = 13e-6  # K_H at moisture 0.10 [1/Pa], one-dimensional; fits the table's required pressures to rounding
RATE_EXPONENT = 0.018  # of yield pressure over speed: 4.2 % per decade, middle of the 2.5-7 % of unsaturated clay
HECKEL_FACTOR = (0.55, 0.78, 1.0, 1.22, 1.45)  # K_H over that at the table's moistures: wetter mix presses easier
PUBLISHED = (0.10, 0.98)  # moisture and density ratio of the published machine
ROLLING_PRESSURE = 0.5e6  # required pressure beyond which rolling does not reach the density [Pa]
ROLLING_SATURATION = 0.95  # saturation beyond which pore water carries the roller [-]


@dataclass(frozen=True)
class Parameter:
    """One parameter of the mix: its value with its spread from `low` to `high`, in `unit`.

    `flag` says how it is known: measured, analogous (to another material), assumed, calibrated (to the published
    machine), derived (phase relations) or given; `origin` says it in words.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    flag: str
    origin: str

    def at(self, share):
        """The value at a share of the spread, 0 to 1: by ratio where the value is in the middle by ratio, else evenly.

        >>> f"{prior(0.10, 0.98).parameter('required_pressure').at(0.5) / 1e3:.0f} kPa"
        '203 kPa'
        """
        if self.low > 0 and np.isclose(self.low * self.high, self.value**2, rtol=1e-9):
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))


@dataclass(frozen=True)
class Achievability:
    """Whether rolling can reach the density (`possible`), and if not the `reason` in words."""

    possible: bool
    reason: str

    def __bool__(self):
        return self.possible


@dataclass(frozen=True)
class Mix:
    """A mix at one moisture W and density ratio k [-], made by `prior`; `mix.poisson` is the value of "poisson"."""

    moisture: float
    density_ratio: float
    parameters: tuple[Parameter, ...]

    def parameter(self, name):
        """The `Parameter` of that name: value, spread, unit, flag and origin."""
        require_known("mix parameter", name, PARAMETER_NAMES)
        return next(parameter for parameter in self.parameters if parameter.name == name)

    def __getattr__(self, name):
        if name in PARAMETER_NAMES:
            return self.parameter(name).value
        raise AttributeError(f"a mix has no '{name}'; it has {', '.join(PARAMETER_NAMES)}")

    @property
    def density_achievable(self):
        """`Achievability`: not reachable by rolling above 0.5 MPa of required pressure or 0.95 of saturation."""
        reasons = []
        if self.required_pressure > ROLLING_PRESSURE:
            reasons.append(
                f"it takes {self.required_pressure / 1e6:.2f} MPa, more than the {ROLLING_PRESSURE / 1e6:g} MPa of "
                "rolling: add water or ask for less density"
            )
        if self.saturation > ROLLING_SATURATION:
            reasons.append(
                f"its pores are filled to {self.saturation:.4f}, more than {ROLLING_SATURATION:g}, and the water would "
                "carry the roller: take less water or ask for less density"
            )
        if not reasons:
            return Achievability(True, "")
        where = f"density ratio {self.density_ratio:g} at moisture {self.moisture:g}"
        return Achievability(False, f"{where} is not reachable by rolling: {'; '.join(reasons)}")


@dataclass(frozen=True)
class ParameterSource:
    """What `mix.csv` does not say of a parameter; `spread` maps a value to its (low, high)."""

    unit: str
    flag: str
    words: str
    spread: Callable[[float], tuple[float, float]]


def factor(by):
    """Spread of x/by ... x by."""
    return lambda value: (value / by, value * by)


def plus_minus(by):
    """Spread of x - by ... x + by."""
    return lambda value: (value - by, value + by)


def between(low, high):
    """Spread of one range for the whole table."""
    return lambda value: (low, high)


_HECKEL = "Heckel curve through the published operating point; curve and moisture factor assumed"
_PHASES = "phase relations, grains 2650 kg/m3"
_TRIBOMETRY = "soil on steel and fresh-concrete tribometry"
_TRIAXIAL = "triaxial tests on fresh concrete, soils"

PARAMETER_SOURCES = {
    "bulk_density": ParameterSource("kg/m3", "derived", _PHASES, factor(1.02)),
    "saturation": ParameterSource("-", "derived", _PHASES, factor(1.02)),
    "required_pressure": ParameterSource("Pa", "assumed", _HECKEL, factor(2.5)),
    "plastic_modulus": ParameterSource("Pa", "assumed", f"one-pass column slope at k; {_HECKEL}", factor(2.5)),
    "relaxed_modulus": ParameterSource("Pa", "assumed", f"two-sided contact, no compaction; {_HECKEL}", factor(2.5)),
    "unloading_modulus": ParameterSource("Pa", "analogous", "compacted unsaturated sandy soil", factor(2.0)),
    "poisson": ParameterSource("-", "analogous", "compacted soil, 0.30 at the operating point", plus_minus(0.07)),
    "instant_over_relaxed": ParameterSource(
        "-", "assumed", "trapped air beside the skeleton (argued)", between(1.3, 2.0)
    ),
    "relaxation_time": ParameterSource("s", "assumed", "drainage of pore air (argued)", factor(5.0)),
    "pore_air_modulus": ParameterSource("Pa", "derived", "atmospheric pressure / (1 - k)", factor(2.0)),
    "friction_angle": ParameterSource("deg", "analogous", _TRIAXIAL, plus_minus(5.0)),
    "cohesion": ParameterSource("Pa", "analogous", _TRIAXIAL, factor(2.0)),
    "steel_friction": ParameterSource("-", "analogous", _TRIBOMETRY, plus_minus(0.1)),
    "heckel_slope": ParameterSource("1/Pa", "assumed", f"one-dimensional K_H; {_HECKEL}", factor(2.5)),
    "rate_exponent": ParameterSource("-", "analogous", "relaxation of unsaturated clay", between(0.011, 0.029)),
    "effective_modulus": ParameterSource(
        "Pa", "assumed", "secant modulus of (1.5)-(1.6): relaxed_modulus", factor(2.5)
    ),
}
PARAMETER_NAMES = tuple(PARAMETER_SOURCES)
TIED = ("required_pressure", "plastic_modulus", "relaxed_modulus", "heckel_slope", "effective_modulus")  # to PUBLISHED
LOGARITHMIC = (  # parameters that span decades and are interpolated by ratio
    "plastic_modulus",
    "relaxed_modulus",
    "unloading_modulus",
    "relaxation_time",
    "pore_air_modulus",
    "cohesion",
)


def prior(moisture, density_ratio, overrides=None):
    """What the table expects of a mix, a `Mix`; `overrides` replace values by name.

    Parameters
    ----------
    moisture : W, water mass / dry mass [-], 0.08 ... 0.12
    density_ratio : k, bulk density / zero-air density [-], 0.90 ... 0.99
    overrides : name -> value [SI, friction_angle in degrees]; flagged "given", without spread

    `effective_modulus` follows `relaxed_modulus`, overridden or not, unless it is overridden itself.

    >>> mix = prior(moisture=0.10, density_ratio=0.98)
    >>> q = mix.parameter("required_pressure")
    >>> f"{q.value / 1e3:.0f} kPa ({q.low / 1e3:.0f} to {q.high / 1e3:.0f}), {q.flag}"
    '203 kPa (135 to 305), calibrated'
    """
    overrides = dict(overrides or {})
    values = _table_values(moisture, density_ratio)
    for name, value in overrides.items():
        _refuse_override(name, value)
    values.update(overrides)
    if "relaxed_modulus" in overrides:
        overrides.setdefault("effective_modulus", values["relaxed_modulus"])
    values["effective_modulus"] = overrides.get("effective_modulus", values["relaxed_modulus"])
    published = max(abs(moisture - PUBLISHED[0]), abs(density_ratio - PUBLISHED[1])) < 1e-9
    parameters = (_parameter(name, float(values[name]), name in overrides, published) for name in PARAMETER_NAMES)
    return Mix(float(moisture), float(density_ratio), tuple(parameters))


def table_nodes():
    """(moistures [-], density ratios [-]) at which the table has values, ascending."""
    moistures, ratios, _ = _table()
    return tuple(moistures.tolist()), tuple(ratios.tolist())


def bulk_density(moisture, density_ratio):
    """Bulk density rho [kg/m3] of a mix.

        rho = k (1 + W)/(1/rho_s + W/rho_w)

    Parameters
    ----------
    moisture : W, water mass / dry mass [-], >= 0
    density_ratio : k, bulk density / zero-air density [-], 0 < k <= 1

    References
    ----------
    Phase relations of soil mechanics, rho_s 2650, rho_w 1000 kg/m3.

    >>> f"{bulk_density(0.10, 0.98):.0f} kg/m3"
    '2258 kg/m3'
    """
    _refuse_phases(moisture, density_ratio)
    return density_ratio * (1 + np.asarray(moisture)) / (1 / SOLIDS + np.asarray(moisture) / WATER)


def saturation(moisture, density_ratio):
    """Saturation S [-], the share of the pores that water fills.

        S = (W/rho_w) / [(1/rho_s + W/rho_w)/k - 1/rho_s]

    Parameters
    ----------
    moisture : W, water mass / dry mass [-], > 0
    density_ratio : k, bulk density / zero-air density [-], 0 < k <= 1

    References
    ----------
    Phase relations of soil mechanics, rho_s 2650, rho_w 1000 kg/m3.

    >>> f"{saturation(0.10, 0.98):.3f}"
    '0.911'
    """
    require_positive(moisture=moisture)
    _refuse_phases(moisture, density_ratio)
    water = np.asarray(moisture) / WATER
    return water / ((1 / SOLIDS + water) / density_ratio - 1 / SOLIDS)


def _refuse_phases(moisture, density_ratio):
    require_nonnegative(moisture=moisture)
    require_positive(density_ratio=density_ratio)
    require_between(0, 1, density_ratio=density_ratio)


def _refuse_override(name, value):
    require_known("mix parameter", name, PARAMETER_NAMES)
    if name in ("cohesion", "steel_friction", "rate_exponent"):
        require_nonnegative(**{name: value})
    elif name == "poisson" and not 0 <= value < 0.5:
        raise ValueError(f"`poisson` must lie in [0, 0.5), got {value!r}")
    elif name != "poisson":
        require_positive(**{name: value})


def _parameter(name, value, given, published):
    origin = PARAMETER_SOURCES[name]
    if given:
        return Parameter(name, value, value, value, origin.unit, "given", "given in place of the prior")
    if name in TIED and published:
        return Parameter(name, value, *factor(1.5)(value), origin.unit, "calibrated", origin.words)
    return Parameter(name, value, *origin.spread(value), origin.unit, origin.flag, origin.words)


def _table_values(moisture, density_ratio):
    """Every parameter but effective_modulus at (W, k), by name."""
    moistures, ratios, _ = _table()
    require_between(moistures[0], moistures[-1], moisture=moisture)
    require_between(ratios[0], ratios[-1], density_ratio=density_ratio)
    values = _between_nodes(moisture, density_ratio)
    values["bulk_density"] = bulk_density(moisture, density_ratio)
    values["saturation"] = saturation(moisture, density_ratio)
    values["heckel_slope"] = HECKEL_SLOPE * np.exp(np.interp(moisture, moistures, np.log(HECKEL_FACTOR)))
    values["rate_exponent"] = RATE_EXPONENT
    return values


def _between_nodes(moisture, density_ratio):
    """Every column at (W, k): linear in u = -ln(1 - k), then linear in W, of the value or of its logarithm.

    Linear pieces pass through the nodes and are monotone where the nodes are. The required pressure is Heckel's:
    linear in u, its logarithm linear in W as that of 1/K_H.
    """
    moistures, ratios, columns = _table()
    rows = _between(-np.log1p(-ratios), _scaled(), -np.log1p(-density_ratio))
    pressure = tuple(columns).index("required_pressure")
    rows[pressure] = np.log(rows[pressure])
    values = dict(zip(columns, _between(moistures, rows, moisture).tolist(), strict=True))
    exponential = (*LOGARITHMIC, "required_pressure")
    return {name: float(np.exp(value)) if name in exponential else value for name, value in values.items()}


def _between(nodes, values, x):
    """Values along the last axis, one at each node, by straight lines at x."""
    left = min(int(np.searchsorted(nodes, x, side="right")) - 1, len(nodes) - 2)
    share = (x - nodes[left]) / (nodes[left + 1] - nodes[left])
    return (1 - share) * values[..., left] + share * values[..., left + 1]


@cache
def _scaled():
    """The columns as they are interpolated over u, shape (columns, moistures, ratios)."""
    _, _, columns = _table()
    return np.array([np.log(column) if name in LOGARITHMIC else column for name, column in columns.items()])


@cache
def _table():
    """Nodes of moisture and of density ratio, and each column as an array of shape (moistures, ratios)."""
    from importlib.resources import files  # 40 ms that a start-up without a mix need not pay

    text = files("compact").joinpath("data/mix.csv").read_text().splitlines()
    header = text[0].split(",")
    cells = np.array([line.split(",") for line in text[1:]], dtype=float).T
    moistures, ratios = np.unique(cells[0]), np.unique(cells[1])
    columns = {name: cell.reshape(len(moistures), len(ratios)) for name, cell in zip(header, cells, strict=True)}
    return moistures, ratios, {name: columns[name] for name in header if name in PARAMETER_NAMES}
