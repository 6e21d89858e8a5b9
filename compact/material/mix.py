"""Prior parameters of a mix from its moisture and density ratio, each with its spread and source.

No publication states these parameters as functions of moisture W and density ratio k. `data/mix.csv` is a prior for a
stiff fine-grained mix. Only the required pressure and the relaxed modulus at W 0.10, k 0.98 are calibrated, to a
published machine. Values are interpolated between the nodes of the table and never extrapolated.

The coordinate along k is u = -ln(1 - k), that of Heckel's curve

    q = f ln[(1 - k0)/(1 - k)] / K_H,    K_H = f 13/MPa x factor(W),    k0 = 0.72,
    f = 1 + m ln(1 + OPERATING_RATE/reference rate).

The required pressures are those of machines at work. The slope at rest K_H therefore includes the factor f of the rate
of compaction there. The required pressure is linear in u, and so is the logarithm of every power of 1 - k (pore air,
plastic slope). All pressures and moduli scale as 1/L with the roller length L, which no source states.

References
----------
R. W. Heckel, Trans. Metall. Soc. AIME 221 (1961) 671; K. Terzaghi, R. B. Peck, G. Mesri, Soil Mechanics in Engineering
Practice, Wiley 1996, section 16.7 (secondary compression).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from compact.material.laws import REFERENCE_RATE, SATURATION_LIMIT, require_poisson
from compact.numerics import Array, validation

GRAIN_DENSITY = 2650.0  # [kg/m3], density of the solids
WATER_DENSITY = 1000.0  # [kg/m3], density of water
LOOSE_DENSITY_RATIO = 0.72  # [-], k0, start of Heckel's curve; a constant of the curve, not an allowed density
HECKEL_SLOPE = 13e-6  # [1/Pa], one-dimensional K_H/f at moisture 0.10; fits the required pressures to rounding
HECKEL_SLOPE_FACTORS = (0.55, 0.78, 1.0, 1.22, 1.45)  # [-], K_H over that at the moistures of the table
AIR_PERMEABILITY = 1e-13  # [m2], intrinsic, to air, of the fed mix; unmeasured, 1e-14 of silty to 1e-12 of sandy mixes
OCCLUSION_SATURATION = 0.90  # [-], saturation at which the paths of the air are closed
RATE_SENSITIVITY = 0.02  # [-], 4.6 % per decade; C_alpha/C_c of granular soils is .02 +- .01, of powders 0 to .05
OPERATING_RATE = 0.2  # [1/s], of the published machine; .13 to .25 at .13 m/s, which changes f by 1 %
PUBLISHED_MOISTURE, PUBLISHED_DENSITY_RATIO = 0.10, 0.98  # [-], of the published machine
STATE_TOLERANCE = 1e-9  # [-], of moisture and density ratio
CALIBRATED_SPREAD = 1.5  # [-], factor of the spread of parameters calibrated to the published machine
ROLLING_PRESSURE = 0.5e6  # [Pa], largest required pressure at which rolling achieves the density
ROLLING_SATURATION = 0.95  # [-], largest saturation at which pore water does not carry the roller


@dataclass(frozen=True)
class Parameter:
    """Parameter of a mix with its spread.

    Parameters
    ----------
    name : str
        Name, one of `PARAMETER_NAMES`.
    value, low, high : float
        Value and spread, in `unit`.
    unit : str
    flag : str
        Source in one word: measured, analogous (another material), assumed, calibrated (to the published machine),
        derived (phase relations) or given (by the user).
    origin : str
        Source in words.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str
    flag: str
    origin: str

    def at(self, share: float) -> float:
        """Interpolate the spread.

        Parameters
        ----------
        share : float
            Position in the spread, 0 at `low` and 1 at `high` [-].

        Returns
        -------
        float
            Geometric interpolation where the value is the geometric mean of the spread, else linear.

        Examples
        --------
        >>> f"{prior(0.10, 0.98).parameter('required_pressure').at(0.5) / 1e3:.0f} kPa"
        '203 kPa'
        """
        if self.low > 0 and np.isclose(self.low * self.high, self.value**2, rtol=1e-9):
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))

    def spread_about(self, value: float, share: float | None = None) -> tuple[float, float]:
        """Return the spread in proportion about another value, or a share of that value on both sides.

        The saturation limit is measured from 1: its spread is that of the last air voids.

        Parameters
        ----------
        value : float
            Other value, in `unit`.
        share : float, optional
            Half-width over the value [-]; that of the spread by default, whose own value must not be 0.

        Examples
        --------
        >>> limit = prior(0.10, 0.98).parameter("saturation_limit")
        >>> "{:.4f} to {:.4f}".format(*limit.spread_about(0.999))
        '0.9975 to 0.9995'
        """
        origin = 1.0 if self.name == "saturation_limit" else 0.0
        own = ((end - origin) / (self.value - origin) for end in (self.low, self.high))
        factors = own if share is None else (1 - share, 1 + share)
        low, high = sorted(origin + factor * (value - origin) for factor in factors)
        return low, high


@dataclass(frozen=True)
class Mix:
    """Mix at one moisture and density ratio, built by `prior`.

    Parameters
    ----------
    moisture : float
        Moisture W, water mass over dry mass [-].
    density_ratio : float
        Density ratio k, bulk density over zero-air density [-].
    parameters : tuple of Parameter
        All parameters; `mix.poisson` is the value of the parameter "poisson".
    """

    moisture: float
    density_ratio: float
    parameters: tuple[Parameter, ...]

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of a name; raise ValueError for an unknown name."""
        validation.require_known("mix parameter", name, PARAMETER_NAMES)
        return next(parameter for parameter in self.parameters if parameter.name == name)

    def __getattr__(self, name: str) -> float:
        if name in PARAMETER_NAMES:
            return self.parameter(name).value
        raise AttributeError(f"a mix has no '{name}'; it has {', '.join(PARAMETER_NAMES)}")

    @property
    def not_achievable(self) -> str:
        """Reason why rolling does not achieve the density; empty if it does.

        Rolling requires a pressure of at most 0.5 MPa and a saturation of at most 0.95.
        """
        reasons = []
        if self.required_pressure > ROLLING_PRESSURE:
            reasons.append(
                f"the required pressure of {self.required_pressure / 1e6:.2f} MPa exceeds the "
                f"{ROLLING_PRESSURE / 1e6:g} MPa of rolling; add water or reduce the density ratio"
            )
        if self.saturation > ROLLING_SATURATION:
            reasons.append(
                f"the saturation of {self.saturation:.4f} exceeds {ROLLING_SATURATION:g}, and pore water would carry "
                "the roller; use less water or reduce the density ratio"
            )
        state = f"density ratio {self.density_ratio:g} at moisture {self.moisture:g} is not achievable by rolling"
        return f"{state}: {'; '.join(reasons)}" if reasons else ""


_HECKEL_CURVE = "Heckel curve through the published operating point; curve and moisture factor assumed"
_TRIBOMETRY = "soil on steel and fresh-concrete tribometry"
_PHASES, _TRIAXIAL = "phase relations, grains 2650 kg/m3", "triaxial tests on fresh concrete, soils"
_COLUMN_SLOPE = f"one-pass column slope at k; {_HECKEL_CURVE}"
_TWO_SIDED = f"two-sided contact, no compaction; {_HECKEL_CURVE}"
_LOOSE = "cohesion of loose mix, that of the product without a measurement"
_PERMEABILITY = "intrinsic, of the fed mix: silty to sandy soils at its saturation"
_VISCOSITY = "keeps bands of shear wider than elements; not measured"
_CLOSED = "judgement: the last air voids close there; no measurement"
_JAKY = "1 - sin(friction_angle) of normally consolidated soils (Jaky)"

# unit, flag and source as of `Parameter`, and spread: a factor x, an amount +-, or the bounds
PARAMETERS: dict[str, tuple[str, str, str, tuple[str, *tuple[float, ...]]]] = {
    "bulk_density": ("kg/m3", "derived", _PHASES, ("x", 1.02)),
    "saturation": ("-", "derived", _PHASES, ("x", 1.02)),
    "required_pressure": ("Pa", "assumed", _HECKEL_CURVE, ("x", 2.5)),
    "plastic_modulus": ("Pa", "assumed", _COLUMN_SLOPE, ("x", 2.5)),
    "relaxed_modulus": ("Pa", "assumed", _TWO_SIDED, ("x", 2.5)),
    "unloading_modulus": ("Pa", "analogous", "compacted unsaturated sandy soil", ("x", 2.0)),
    "poisson": ("-", "analogous", "compacted soil, 0.30 at the operating point", ("+-", 0.07)),
    "instant_over_relaxed": ("-", "assumed", "trapped air in parallel with the skeleton (estimated)", ("to", 1.3, 2.0)),
    "relaxation_time": ("s", "assumed", "drainage of pore air (estimated)", ("x", 5.0)),
    "pore_air_modulus": ("Pa", "derived", "atmospheric pressure / (1 - k)", ("x", 2.0)),
    "friction_angle": ("deg", "analogous", _TRIAXIAL, ("+-", 5.0)),
    "cohesion": ("Pa", "analogous", _TRIAXIAL, ("x", 2.0)),
    "steel_friction": ("-", "analogous", _TRIBOMETRY, ("+-", 0.1)),
    "heckel_slope": ("1/Pa", "assumed", f"one-dimensional K_H at rest; {_HECKEL_CURVE}", ("x", 2.5)),
    "cohesion_loose": ("Pa", "assumed", _LOOSE, ("x", 4.0, 2.0)),
    "earth_pressure_coefficient": ("-", "analogous", _JAKY, ("+-", 0.05)),
    "dilatancy_angle": ("deg", "assumed", "loose mix shears at constant volume", ("to", 0.0, 5.0)),
    "shear_viscosity": ("Pa m", "assumed", _VISCOSITY, ("to", 0.0, 1200.0)),
    "saturation_limit": ("-", "assumed", _CLOSED, ("to", 0.995, 0.999)),
    "rate_sensitivity": ("-", "analogous", "secondary compression of granular soils, C_alpha/C_c", ("to", 0.01, 0.03)),
    "reference_rate": ("1/s", "assumed", "laboratory compression test", ("x", 10.0)),
    "effective_modulus": ("Pa", "assumed", "secant modulus of (1.5)-(1.6): relaxed_modulus", ("x", 2.5)),
    "air_permeability": ("m2", "assumed", _PERMEABILITY, ("to", 1e-14, 1e-12)),
    "occlusion_saturation": ("-", "analogous", "compacted soils, end of continuous air", ("to", 0.85, 0.95)),
}
PARAMETER_NAMES = tuple(PARAMETERS)
CALIBRATED = ("required_pressure", "plastic_modulus", "relaxed_modulus", "heckel_slope", "effective_modulus")
LOGARITHMIC = {  # parameters that span decades; their logarithms are interpolated
    "plastic_modulus", "relaxed_modulus", "unloading_modulus", "relaxation_time", "pore_air_modulus", "cohesion",
}  # fmt: skip
MAY_BE_ZERO = {
    "cohesion", "cohesion_loose", "steel_friction", "rate_sensitivity", "dilatancy_angle", "shear_viscosity",
}  # fmt: skip
SHEAR_VISCOSITY = 600.0  # [Pa m]; adds up to 10 kPa to the shear line under the published roller


def prior(moisture: float, density_ratio: float, overrides: Mapping[str, float] | None = None) -> Mix:
    """Return the prior parameters of a mix.

    Parameters
    ----------
    moisture : float
        Moisture W, water mass over dry mass [-], 0.08 to 0.12.
    density_ratio : float
        Density ratio k, bulk density over zero-air density [-], 0.90 to 0.99.
    overrides : mapping of str to float, optional
        Values by name that replace the prior [SI, friction_angle in degrees]; flagged "given", without spread.
        `effective_modulus` equals `relaxed_modulus` unless it is overridden itself, `cohesion_loose` equals `cohesion`,
        and `earth_pressure_coefficient` follows from `friction_angle`.

    Returns
    -------
    Mix

    Examples
    --------
    >>> mix = prior(moisture=0.10, density_ratio=0.98)
    >>> q = mix.parameter("required_pressure")
    >>> f"{q.value / 1e3:.0f} kPa ({q.low / 1e3:.0f} to {q.high / 1e3:.0f}), {q.flag}"
    '203 kPa (135 to 305), calibrated'
    """
    overrides = dict(overrides or {})
    values = _table_values(moisture, density_ratio)
    for name, value in overrides.items():
        validation.require_known("mix parameter", name, PARAMETER_NAMES)
        validation.require_number(**{name: value})
        if name == "poisson":
            require_poisson(value)
        else:
            (validation.require_nonnegative if name in MAY_BE_ZERO else validation.require_positive)(**{name: value})
    values |= overrides
    if "heckel_slope" not in overrides:
        values["heckel_slope"] *= 1 + values["rate_sensitivity"] * np.log1p(OPERATING_RATE / values["reference_rate"])
    if "relaxed_modulus" in overrides:
        overrides.setdefault("effective_modulus", values["relaxed_modulus"])
    jaky = 1 - float(np.sin(np.radians(values["friction_angle"])))
    following = {"effective_modulus": values["relaxed_modulus"], "cohesion_loose": values["cohesion"]}
    values |= following | {"earth_pressure_coefficient": jaky} | overrides
    published = is_same_state((moisture, density_ratio), (PUBLISHED_MOISTURE, PUBLISHED_DENSITY_RATIO))
    parameters = (_parameter(name, float(values[name]), name in overrides, published) for name in PARAMETER_NAMES)
    return Mix(float(moisture), float(density_ratio), tuple(parameters))


def is_same_state(first: tuple[float, float], second: tuple[float, float]) -> bool:
    """Return True for two equal pairs of moisture and density ratio [-]."""
    return bool(np.allclose(first, second, rtol=0, atol=STATE_TOLERANCE))


def scaled_fits(
    moisture: float, density_ratio: float, overrides: Mapping[str, float], fitted_at: Mapping[str, Any] | None
) -> dict[str, float]:
    """Return fitted overrides at another moisture and density ratio than those of the fit.

        value = fitted value x prior(W, k)/prior(W, k of the fit)

    Parameters
    ----------
    moisture, density_ratio : float
        Moisture W and density ratio k [-].
    overrides : mapping of str to float
        Values by name, as of `prior`.
    fitted_at : mapping, optional
        `moisture` and `density_ratio` of the fit, and names of its `parameters`; those that are no overrides or not in
        CALIBRATED are left out.

    Returns
    -------
    dict of str to float
        The scaled values; empty at the moisture and density ratio of the fit.

    Examples
    --------
    >>> fit = {"moisture": 0.10, "density_ratio": 0.98, "parameters": ["heckel_slope"]}
    >>> f"{scaled_fits(0.08, 0.98, {'heckel_slope': 15.23e-6}, fit)['heckel_slope'] * 1e6:.2f} /MPa"
    '8.38 /MPa'
    """
    if fitted_at is None:
        return {}
    state, fitted = (moisture, density_ratio), (fitted_at["moisture"], fitted_at["density_ratio"])
    if is_same_state(state, fitted):
        return {}
    here, there = prior(*state), prior(*fitted)
    names = (name for name in fitted_at["parameters"] if name in CALIBRATED and name in overrides)
    return {name: overrides[name] * getattr(here, name) / getattr(there, name) for name in names}


def table_nodes() -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the moistures and the density ratios of the nodes of the table [-], ascending."""
    moistures, ratios, *_ = _table()
    return tuple(moistures.tolist()), tuple(ratios.tolist())


def bulk_density(moisture: ArrayLike, density_ratio: ArrayLike) -> Array:
    """Compute the bulk density of a mix [kg/m3].

        rho = k (1 + W)/(1/rho_s + W/rho_w)

    Parameters
    ----------
    moisture : array_like
        Moisture W, water mass over dry mass [-], >= 0.
    density_ratio : array_like
        Density ratio k, bulk density over zero-air density [-], 0 < k <= 1.

    Returns
    -------
    ndarray
        Bulk density [kg/m3].

    References
    ----------
    Phase relations of soil mechanics with rho_s 2650 and rho_w 1000 kg/m3.

    Examples
    --------
    >>> f"{bulk_density(0.10, 0.98):.0f} kg/m3"
    '2258 kg/m3'
    """
    _require_phases(moisture, density_ratio)
    W, k = np.asarray(moisture), np.asarray(density_ratio)
    return k * (1 + W) / (1 / GRAIN_DENSITY + W / WATER_DENSITY)


def saturation(moisture: ArrayLike, density_ratio: ArrayLike) -> Array:
    """Compute the saturation, the share of the pore volume filled with water [-].

        S = (W/rho_w) / [(1/rho_s + W/rho_w)/k - 1/rho_s]

    Parameters
    ----------
    moisture : array_like
        Moisture W, water mass over dry mass [-], > 0.
    density_ratio : array_like
        Density ratio k, bulk density over zero-air density [-], 0 < k <= 1.

    Returns
    -------
    ndarray
        Saturation [-].

    References
    ----------
    Phase relations of soil mechanics with rho_s 2650 and rho_w 1000 kg/m3.

    Examples
    --------
    >>> f"{saturation(0.10, 0.98):.3f}"
    '0.911'
    """
    validation.require_positive(moisture=moisture)
    _require_phases(moisture, density_ratio)
    water = np.asarray(moisture) / WATER_DENSITY
    return water / ((1 / GRAIN_DENSITY + water) / np.asarray(density_ratio) - 1 / GRAIN_DENSITY)


def _require_phases(moisture: ArrayLike, density_ratio: ArrayLike) -> None:
    validation.require_nonnegative(moisture=moisture)
    validation.require_positive(density_ratio=density_ratio)
    validation.require_between(0, 1, density_ratio=density_ratio)


def _parameter(name: str, value: float, overridden: bool, published: bool) -> Parameter:
    """Return a parameter with the spread of its source, or of the published machine; without spread if overridden."""
    unit, flag, words, (kind, *by) = PARAMETERS[name]
    if overridden:
        return Parameter(name, value, value, value, unit, "given", "prescribed in place of the prior")
    if name in CALIBRATED and published:
        flag, by = "calibrated", [CALIBRATED_SPREAD]
    low, high = by[0], by[-1]
    if kind == "x":
        low, high = value / low, value * high
    elif kind == "+-":
        low, high = value - low, value + high
    return Parameter(name, value, low, high, unit, flag, words)


def _table_values(moisture: float, density_ratio: float) -> dict[str, float]:
    """Return every parameter but effective_modulus at (W, k), by name; `heckel_slope` without its rate factor.

    Interpolation is linear in u = -ln(1 - k), then linear in W, of the value or of its logarithm. It passes through the
    nodes and is monotone where the nodes are. The required pressure is Heckel's: linear in u, its logarithm linear in W
    as that of 1/K_H.
    """
    moistures, ratios, names, columns = _table()
    validation.require_between(moistures[0], moistures[-1], moisture=moisture)
    validation.require_between(ratios[0], ratios[-1], density_ratio=density_ratio)
    rows = _linear(-np.log1p(-ratios), columns, -np.log1p(-density_ratio))
    pressure = names.index("required_pressure")
    rows[pressure] = np.log(rows[pressure])
    exponential = LOGARITHMIC | {"required_pressure"}
    interpolated = zip(names, _linear(moistures, rows, moisture).tolist(), strict=True)
    values = {name: float(np.exp(value)) if name in exponential else value for name, value in interpolated}
    return values | {
        "bulk_density": float(bulk_density(moisture, density_ratio)),
        "saturation": float(saturation(moisture, density_ratio)),
        "heckel_slope": HECKEL_SLOPE * np.exp(np.interp(moisture, moistures, np.log(HECKEL_SLOPE_FACTORS))),
        "saturation_limit": SATURATION_LIMIT,
        "rate_sensitivity": RATE_SENSITIVITY,
        "reference_rate": REFERENCE_RATE,
        "dilatancy_angle": 0.0,
        "shear_viscosity": SHEAR_VISCOSITY,
        "air_permeability": AIR_PERMEABILITY,
        "occlusion_saturation": OCCLUSION_SATURATION,
    }


def _linear(nodes: Array, values: Array, x: float) -> Array:
    """Interpolate values along the last axis, one at each node, linearly at x."""
    left = min(int(np.searchsorted(nodes, x, side="right")) - 1, len(nodes) - 2)
    share = (x - nodes[left]) / (nodes[left + 1] - nodes[left])
    return (1 - share) * values[..., left] + share * values[..., left + 1]


@cache
def _table() -> tuple[Array, Array, list[str], Array]:
    """Moistures, density ratios, names and columns of mix.csv as interpolated, shape (names, moistures, ratios)."""
    from importlib.resources import files  # its import costs 40 ms, which scenes without a mix avoid

    header, *lines = files("compact").joinpath("data/mix.csv").read_text("utf-8").splitlines()
    cells = dict(zip(header.split(","), np.array([line.split(",") for line in lines], float).T, strict=True))
    moistures, ratios = np.unique(cells["moisture"]), np.unique(cells["density_ratio"])
    names = [name for name in cells if name in PARAMETER_NAMES]
    columns = np.array([np.log(cells[name]) if name in LOGARITHMIC else cells[name] for name in names])
    return moistures, ratios, names, columns.reshape(len(names), len(moistures), len(ratios))
