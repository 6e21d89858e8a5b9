"""Material laws of the layer: linear elastic, linear viscoelastic, and irreversible compaction by an elliptic cap.

Every law has one Poisson's ratio. The laws are parameter records; the engines integrate them.

Slopes of the Drucker-Prager cap follow from the angles of friction and dilatancy and the earth pressure coefficient.

In plane strain the plastic flow leaves no strain across the plane. With s = sin phi, the Mohr-Coulomb limit is met by

    N = 3 sin psi/sqrt(3 + sin^2 psi),    M = s/[sqrt((1 - N^2/9)/3) + N s/9]

exactly for psi = 0, where M = sqrt(3) s, and psi = phi, where M = N. Confined compression on a cap of slope Mc ends
at the stress ratio eta = q/P, where Mc^2 = eta^2 + 3 eta by associated flow. All stresses are shifted by pt, so that a
coefficient K0 = s_h/s_v belongs to one vertical stress s_v:

    K0' = (K0 s_v + pt)/(s_v + pt),    eta = 3 (1 - K0')/(1 + 2 K0')

Mix in confined compression must flow on the cap, K0' > (3 - M)/(3 + 2 M). The cap must not be flatter than the line,
Mc >= M.

References
----------
R. W. Heckel, Trans. Metall. Soc. AIME 221 (1961) 671 (pressure over density); K. H. Roscoe and J. B. Burland, On the
generalised stress-strain behaviour of wet clay, in Engineering Plasticity, CUP 1968, 535-609 (elliptic cap); G. R.
Johnson and W. H. Cook, Proc. 7th Int. Symp. on Ballistics (1983) 541-547 (strength over the logarithm of the rate);
D. C. Drucker and W. Prager, Soil mechanics and plastic analysis or limit design, Q. Appl. Math. 10 (1952) 157-165;
J. Jaky, A nyugalmi nyomas tenyezoje, J. Soc. Hungarian Architects and Engineers 78 (1944) 355-358 (K0 = 1 - sin phi).
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from compact.material.confined_compression import TERMS, elastic_polynomial
from compact.numerics import Array, validation

MEASURED_DENSITY_RATIO = 0.99  # [-], end of measured curves; beyond, Heckel's curve is extrapolated to the limit
SATURATION_LIMIT = 0.998  # [-], prior of the density ratio at which the last air voids are closed
SATURATION_MODULUS = 0.8e9  # [Pa], of grains and water beyond it; their 8 GPa change a load by 0.1 %, at lost digits
REFERENCE_RATE = 1e-3  # [1/s], of a laboratory compression test: some 5 % of strain in a minute
HECKEL_MIN_PRESSURE = 0.01  # [-], K_H pc below which pc departs from the curve and tends to half of this value

SubcriticalSide = Literal["ellipse", "flat"]
HeckelTest = Literal["isotropic", "confined"]


def require_poisson(poisson: float) -> None:
    """Require a Poisson's ratio of compressible material."""
    validation.require_number(poisson=poisson)
    if not 0 <= poisson < 0.5:
        raise ValueError(f"`poisson` must lie in [0, 0.5), got {poisson!r}")


@dataclass(frozen=True, kw_only=True)
class Elastic:
    """Isotropic linear elastic layer.

    Parameters
    ----------
    youngs_modulus : float
        Young's modulus E [Pa], > 0.
    poisson : float
        Poisson's ratio nu [-], 0 <= nu < 0.5.
    """

    youngs_modulus: float
    poisson: float

    def __post_init__(self) -> None:
        validation.require_positive(youngs_modulus=self.youngs_modulus)
        require_poisson(self.poisson)

    @property
    def contact_modulus(self) -> float:
        """Contact modulus E* = E/(1 - nu^2) under a rigid roller in plane strain [Pa]."""
        return self.youngs_modulus / (1 - self.poisson**2)


@dataclass(frozen=True, kw_only=True)
class Viscoelastic(Elastic):
    """Viscoelastic layer: a Prony series on the relaxed modulus.

        E(t) = E [1 + sum_i share_i exp(-t/time_i)]

    Parameters
    ----------
    youngs_modulus : float
        Relaxed modulus E [Pa], > 0.
    poisson : float
        Poisson's ratio nu [-], 0 <= nu < 0.5, constant in time.
    branches : tuple of (float, float)
        Stiffness share [-] > 0 and relaxation time [s] > 0 of each branch.

    Examples
    --------
    >>> mix = Viscoelastic(youngs_modulus=10e6, poisson=0.3, branches=((1.0, 0.1),))
    >>> abs(mix.complex_modulus(10.0))
    15811388.300841896
    """

    branches: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        shape = validation.as_numbers("branches", self.branches).shape
        if shape != (0,) and (len(shape) != 2 or shape[1] != 2):
            raise ValueError(f"`branches` must be pairs (stiffness share, relaxation time), got {self.branches!r}")
        for share, time in self.branches:
            validation.require_positive(stiffness_share=share, relaxation_time=time)

    def complex_modulus(self, frequency: float) -> complex:
        """Compute the complex modulus [Pa].

            E*(w) = E [1 + sum_i share_i i w time_i/(1 + i w time_i)]

        Parameters
        ----------
        frequency : float
            Angular frequency w [rad/s].

        Returns
        -------
        complex
            Modulus [Pa].
        """
        terms = (share * 1j * frequency * time / (1 + 1j * frequency * time) for share, time in self.branches)
        return self.youngs_modulus * (1 + sum(terms))


@dataclass(frozen=True, kw_only=True)
class Compaction:
    """Irreversible compaction: an elliptic cap that hardens along Heckel's curve, elastic inside.

        f = q^2/M^2 + (p - u + pt)(p - u - pc) <= 0,  associated flow,  dk/k = plastic volumetric strain
        pc(k) = ln[(1 - k0)/(1 - min(k, k_s))]/K_H * [1 + m ln(1 + rate/reference_rate)]
        u(k) = K_s ln max(k/k_s, 1)

    p is the mean pressure and q the von Mises stress, compression positive; k is the density ratio at rest. No mix is
    denser than the saturation limit k_s. There grains and water carry any further mean stress: the reaction u keeps k
    near k_s, and the strength grows no more, as in undrained mix. u is a constraint, not the pressure of the pore
    water, and remains after unloading on the flat subcritical side. On the full ellipse zero stress lies outside the
    surface once u > pt. There u derives from a stored energy (K_s/2) ln^2(k/k_s): unloading below p = u - pt loosens
    the mix and gives it back, and plastic work less this energy never decreases.

    A Heckel curve of confined compression, s_v = ln[(1 - k0)/(1 - k)]/K_H, is satisfied by

        pc(k) = [s_v(k) + pt] (1 + g)/A - pt,    A = (1 + sqrt(1 + 4 M^2/9))/2,

    where g is zero for rigid-plastic mix and of second order in the elastic strain; see `confined_compression`.

    `rate` is the mean rate of compaction under the roller, `rolling_contact.compaction_rate`.

    Parameters
    ----------
    unloading_modulus : float
        Young's modulus of unloading and reloading E_u [Pa], > 0.
    poisson : float
        Poisson's ratio nu [-], 0 <= nu < 0.5.
    heckel_slope : float
        K_H of the curve measured in `heckel_test` [1/Pa], > 0.
    loose_density_ratio : float
        k0, start of Heckel's curve and a constant of the curve [-], > 0.
    critical_slope : float
        M = q/(p + pt) at constant volume [-], > 0.
    tensile_strength : float
        Isotropic tensile strength pt [Pa], >= 0.
    fed_density_ratio : float
        Initial density ratio in front of the roller [-], between k0 and 1.
    rate_sensitivity : float
        m [-], >= 0; 0 for a rate-independent mix.
    reference_rate : float
        Rate of compaction [1/s], > 0, below which K_H is valid; well above it pc rises by 2.3 m in a decade.
    dry_side : {"ellipse", "flat"}
        Yield limit on the subcritical side, p < (pc - pt)/2: the ellipse, with dilatant flow, or flat. Flat is
        q = M (pc + pt)/2 down to p = 0, then a quarter ellipse to -pt; pc depends on the largest k so far.
    heckel_test : {"isotropic", "confined"}
        Test of Heckel's curve: isotropic compression, whose pressure is pc, or confined compression, whose vertical
        stress determines pc.
    saturation_limit : float
        k_s, density ratio that mix at rest does not exceed [-], above the initial one, below 1.
    saturation_modulus : float
        K_s of grains and water beyond it [Pa], > 0; it bounds the excess to u/K_s.
    """

    unloading_modulus: float
    poisson: float
    heckel_slope: float
    loose_density_ratio: float
    critical_slope: float
    tensile_strength: float
    fed_density_ratio: float
    rate_sensitivity: float = 0.0
    reference_rate: float = REFERENCE_RATE
    dry_side: SubcriticalSide = "flat"
    heckel_test: HeckelTest = "isotropic"
    saturation_limit: float = SATURATION_LIMIT
    saturation_modulus: float = SATURATION_MODULUS

    def __post_init__(self) -> None:
        moduli = "unloading_modulus heckel_slope loose_density_ratio critical_slope reference_rate saturation_modulus"
        validation.require_fields(self, positive=moduli, nonnegative="tensile_strength rate_sensitivity")
        require_poisson(self.poisson)
        loose, limit = self.loose_density_ratio, self.saturation_limit
        validation.require_inside(loose, 1, saturation_limit=limit)
        validation.require_inside(loose, limit, fed_density_ratio=self.fed_density_ratio)
        validation.require_known("dry_side", self.dry_side, get_args(SubcriticalSide))
        validation.require_known("heckel_test", self.heckel_test, get_args(HeckelTest))

    @property
    def bulk_modulus(self) -> float:
        """Bulk modulus of unloading K [Pa]."""
        return float(self.unloading_modulus) / (3 - 6 * float(self.poisson))

    @property
    def shear_modulus(self) -> float:
        """Shear modulus of unloading G [Pa]."""
        return float(self.unloading_modulus) / (2 + 2 * float(self.poisson))

    @property
    def confined_stress_ratio(self) -> float:
        """Ratio A of s_v + pt to pc + pt in confined compression of rigid-plastic mix [-]."""
        return float(1 + np.sqrt(1 + 4 * self.critical_slope**2 / 9)) / 2

    @property
    def isotropic_slope(self) -> float:
        """Slope K_H of the isotropic curve [1/Pa]."""
        return self.heckel_slope * (self.confined_stress_ratio if self.heckel_test == "confined" else 1.0)

    @property
    def isotropic_offset(self) -> float:
        """Offset K_H pt (A - 1) by which the isotropic curve pc lies below one through the origin, over its K_H [-].

        The tensile strength carries this part of the vertical stress of confined compression.
        """
        return self.tensile_offset * (self.confined_stress_ratio - 1)

    @property
    def tensile_offset(self) -> float:
        """Tensile strength K_H pt over a Heckel curve of confined compression, zero for an isotropic one [-]."""
        return self.heckel_slope * self.tensile_strength if self.heckel_test == "confined" else 0.0

    @property
    def elastic_polynomial(self) -> tuple[float, ...]:
        """Coefficients of the factor 1 + g by which elastic strain raises pc + pt in confined compression [-].

        g = z^2 (c0 + c1 z + c2 z^2 + c3 z^3) with z = x/(1 + x/(K_H K)), x = k/(1 - k); zero for an isotropic curve.
        """
        return elastic_polynomial(self, self.saturation_limit) if self.heckel_test == "confined" else (0.0,) * TERMS

    def yield_pressure(self, density_ratio: ArrayLike) -> Array:
        """Compute the preconsolidation pressure pc(k) [Pa] at rest.

        Parameters
        ----------
        density_ratio : array_like
            Density ratio k [-], > 0.

        Returns
        -------
        ndarray
            Pressure pc [Pa].

        Notes
        -----
        Heckel's curve is used up to the saturation limit, beyond which pc is constant. Mix at rest bears zero stress.
        pc therefore tends to a small positive value near k0, and where a curve of confined compression lies below the
        stress that the tensile strength carries. The transition is smooth.
        """
        inside = np.minimum(np.asarray(density_ratio, dtype=float), self.saturation_limit)
        x = inside / (1 - inside)
        z = x / (1 + x / (self.heckel_slope * self.bulk_modulus))
        gain = z * z * np.polynomial.polynomial.polyval(z, self.elastic_polynomial)
        curve = np.log((1 - self.loose_density_ratio) / (1 - inside))
        curve = curve - self.isotropic_offset + (curve + self.tensile_offset) * gain
        level = np.expm1(2 * np.minimum(curve / HECKEL_MIN_PRESSURE - 1, 0)) * HECKEL_MIN_PRESSURE / 2
        return (np.maximum(curve, HECKEL_MIN_PRESSURE) + level) / self.isotropic_slope

    def saturation_pressure(self, density_ratio: ArrayLike) -> Array:
        """Compute the reaction u(k) of saturated mix [Pa]; 0 up to the saturation limit.

        Parameters
        ----------
        density_ratio : array_like
            Largest density ratio so far [-], > 0.

        Returns
        -------
        ndarray
            Reaction u [Pa].
        """
        excess = np.log(np.maximum(np.asarray(density_ratio, dtype=float) / self.saturation_limit, 1.0))
        return np.asarray(self.saturation_modulus * excess)

    def rate_factor(self, rate: float) -> float:
        """Return the factor 1 + m ln(1 + rate/reference_rate) of pc at a rate of compaction [1/s], >= 0."""
        return 1.0 + self.rate_sensitivity * float(np.log1p(rate / self.reference_rate))


@dataclass(frozen=True, kw_only=True)
class DruckerPragerCap(Compaction):
    """Irreversible compaction: an elliptic cap with the shear line of Drucker and Prager on its subcritical side.

        cap   f = q^2/Mc^2 + (P - u)(P - u - C) <= 0    P above the line,  associated flow
        line  f = q - M P <= 0                          0 <= P,            plastic potential q - N P, no hardening

    P = p + pt and C = pc + pt; without the reaction u both intersect at P/C = Mc^2/(Mc^2 + M^2). Below the centre of
    the cap q <= Mc C/2. The tension cut-off is P = 0. The slope Mc
    of the cap, `critical_slope`, determines the earth pressure in confined compression; M and N determine the angles of
    friction and dilatancy. pc depends on the largest k so far, so that dilatant shear does not soften the cap.

    Parameters
    ----------
    friction_slope : float
        M of the shear line [-], 0 < M <= Mc.
    dilatancy_slope : float
        N of the plastic potential [-], 0 <= N <= M; 0 for shear at constant volume.
    shear_viscosity : float
        S of the stress S d eps_q/ds beyond the line, by the plastic shear strain over the travel s [Pa m], >= 0.

    References
    ----------
    D. C. Drucker, R. E. Gibson and D. J. Henkel, Soil mechanics and work-hardening theories of plasticity, Trans. ASCE
    122 (1957) 338-346; F. L. DiMaggio and I. S. Sandler, Material model for granular soils, J. Eng. Mech. Div. ASCE 97
    (1971) 935-950.
    """

    friction_slope: float
    dilatancy_slope: float = 0.0
    shear_viscosity: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        validation.require_fields(self, positive="friction_slope", nonnegative="shear_viscosity")
        validation.require_between(0, self.critical_slope, friction_slope=self.friction_slope)
        validation.require_between(0, self.friction_slope, dilatancy_slope=self.dilatancy_slope)
        validation.require_known("dry_side", self.dry_side, ("flat",))


def matched_slopes(friction_angle: float, dilatancy_angle: float = 0.0) -> tuple[float, float]:
    """Return the slopes of the shear line and of its plastic potential.

    Parameters
    ----------
    friction_angle, dilatancy_angle : float
        Angles phi and psi in plane strain [deg], 0 <= psi <= phi < 90, phi > 0.

    Returns
    -------
    M, N : float
        Slopes [-].

    Examples
    --------
    >>> M, N = matched_slopes(35.0, 35.0)
    >>> f"{M:.4f} {N:.4f}"
    '0.9431 0.9431'
    """
    if not 0 < friction_angle < 90:
        raise ValueError(
            f"`friction_angle` must lie between 0 and 90 degrees for a shear line, got {friction_angle!r}; mix without "
            'friction requires the law "ellipse" and its cohesion'
        )
    validation.require_between(0, friction_angle, dilatancy_angle=dilatancy_angle)
    s, t = np.sin(np.radians([friction_angle, dilatancy_angle]))
    N = 3 * t / np.sqrt(3 + t * t)
    return float(s / (np.sqrt((1 - N * N / 9) / 3) + N * s / 9)), float(N)


def cap_slope(earth_pressure_coefficient: float, pressure: float, tensile_strength: float) -> float:
    """Return the slope Mc of the cap.

    Parameters
    ----------
    earth_pressure_coefficient : float
        K0 = s_h/s_v of confined compression [-], 0 < K0 < 1.
    pressure : float
        Vertical stress at which it holds [Pa].
    tensile_strength : float
        Isotropic tensile strength pt [Pa].

    Returns
    -------
    float
        Slope Mc [-].

    Examples
    --------
    >>> f"{cap_slope(0.4264, 200e3, 14281.0):.3f}"
    '1.786'
    """
    validation.require_positive(earth_pressure_coefficient=earth_pressure_coefficient, pressure=pressure)
    shifted = (earth_pressure_coefficient * pressure + tensile_strength) / (pressure + tensile_strength)
    ratio = 3 * (1 - shifted) / (1 + 2 * shifted)
    return float(np.sqrt(ratio * ratio + 3 * ratio))


def earth_pressure_bounds(friction_slope: float, pressure: float, tensile_strength: float) -> tuple[float, float]:
    """Return the earth pressure coefficients between which a cap fits a shear line.

    Parameters
    ----------
    friction_slope : float
        Slope M of the line [-].
    pressure, tensile_strength : float
        As of `cap_slope`.

    Returns
    -------
    low, high : float
        K0 at which mix in confined compression slides on the line too, and K0 at which Mc = M [-].
    """
    flattest = (-3 + np.sqrt(9 + 4 * friction_slope**2)) / 2
    shift = tensile_strength / pressure
    low, high = ((3 - ratio) / (3 + 2 * ratio) * (1 + shift) - shift for ratio in (friction_slope, flattest))
    return float(low), float(high)


def drucker_prager_slopes(
    friction_angle: float, cohesion: float, earth_pressure_coefficient: float, pressure: float, dilatancy_angle: float
) -> dict[str, Any]:
    """Return slopes and tensile strength of a cap with a shear line, by the names of `DruckerPragerCap`.

    Parameters
    ----------
    friction_angle, dilatancy_angle : float
        Angles in plane strain [deg].
    cohesion : float
        Cohesion [Pa].
    earth_pressure_coefficient : float
        K0 of confined compression [-].
    pressure : float
        Vertical stress at which K0 holds [Pa].

    Raises
    ------
    ValueError
        If no cap has the coefficient; the message names the bounds.
    """
    validation.require_positive(pressure=pressure)
    M, N = matched_slopes(friction_angle, dilatancy_angle)
    strength = float(cohesion / np.tan(np.radians(friction_angle)))
    low, high = earth_pressure_bounds(M, pressure, strength)
    if not low < earth_pressure_coefficient <= high:
        raise ValueError(
            f"`earth_pressure_coefficient` must be between {low:.4f} and {high:.4f} for a friction angle of "
            f"{friction_angle:g} degrees and a cohesion of {cohesion / 1e3:g} kPa at {pressure / 1e3:.4g} kPa, got "
            f"{earth_pressure_coefficient:.4f}: below, confined mix would slide along the shear line; above, the cap "
            "would be flatter than the line; change the coefficient, `friction_angle` or the cohesion"
        )
    slope = cap_slope(earth_pressure_coefficient, pressure, strength)
    return {"critical_slope": slope, "tensile_strength": strength, "friction_slope": M, "dilatancy_slope": N}


def drucker_prager_cap(
    *,
    friction_angle: float,
    cohesion: float,
    earth_pressure_coefficient: float,
    pressure: float,
    dilatancy_angle: float = 0.0,
    **others: Any,
) -> DruckerPragerCap:
    """Return the law of angles, cohesion and earth pressure whose confined compression follows a Heckel curve.

    Parameters
    ----------
    friction_angle, cohesion, earth_pressure_coefficient, pressure, dilatancy_angle : float
        As of `drucker_prager_slopes`.
    **others
        Further parameters of `DruckerPragerCap`; `heckel_slope` is that of confined compression.
    """
    slopes = drucker_prager_slopes(friction_angle, cohesion, earth_pressure_coefficient, pressure, dilatancy_angle)
    return DruckerPragerCap(heckel_test="confined", **slopes, **others)
