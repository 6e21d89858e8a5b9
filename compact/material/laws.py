"""Material laws of the layer: linear elastic, linear viscoelastic, and irreversible compaction by an elliptic cap.

Every law has one Poisson's ratio. The laws are parameter records; the engines integrate them.

References
----------
R. W. Heckel, Trans. Metall. Soc. AIME 221 (1961) 671 (pressure over density); K. H. Roscoe and J. B. Burland, On the
generalised stress-strain behaviour of wet clay, in Engineering Plasticity, CUP 1968, 535-609 (elliptic cap); G. R.
Johnson and W. H. Cook, Proc. 7th Int. Symp. on Ballistics (1983) 541-547 (strength over the logarithm of the rate).
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from compact.numerics import Array
from compact.numerics.validation import require_fields, require_known, require_positive

HECKEL_MAX_DENSITY_RATIO = 0.99  # [-], end of measured curves; beyond, pc keeps the modulus k dpc/dk of the curve
REFERENCE_RATE = 1e-3  # [1/s], of a laboratory compression test: some 5 % of strain in a minute
HECKEL_MIN_PRESSURE = 0.01  # [-], K_H pc below which pc departs from the curve and tends to half of this value

SubcriticalSide = Literal["ellipse", "flat"]


def _require_poisson(poisson: float) -> None:
    if not 0 <= poisson < 0.5:
        raise ValueError(f"`poisson` must lie in [0, 0.5), got {poisson!r}")


@dataclass(frozen=True)
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
        require_positive(youngs_modulus=self.youngs_modulus)
        _require_poisson(self.poisson)

    @property
    def contact_modulus(self) -> float:
        """Contact modulus E* = E/(1 - nu^2) under a rigid roller in plane strain [Pa]."""
        return self.youngs_modulus / (1 - self.poisson**2)


@dataclass(frozen=True)
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
    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> mix.instant_modulus, abs(mix.complex_modulus(10.0))
    (20000000.0, 15811388.300841896)
    """

    branches: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(len(branch) == 2 for branch in self.branches):
            raise ValueError(f"`branches` must be pairs (stiffness share, relaxation time), got {self.branches!r}")
        for share, time in self.branches:
            require_positive(stiffness_share=share, relaxation_time=time)

    @property
    def instant_modulus(self) -> float:
        """Instantaneous modulus E(0) = E (1 + sum of shares) [Pa]."""
        return self.youngs_modulus * (1 + sum(share for share, _ in self.branches))

    def complex_modulus(self, frequency: float) -> complex:
        """Compute the complex modulus [Pa].

            E*(w) = E [1 + sum_i share_i i w time_i/(1 + i w time_i)]

        Parameters
        ----------
        frequency : float
            Angular frequency w [rad/s].
        """
        terms = (share * 1j * frequency * time / (1 + 1j * frequency * time) for share, time in self.branches)
        return self.youngs_modulus * (1 + sum(terms))


@dataclass(frozen=True)
class Compaction:
    """Irreversible compaction: an elliptic cap that hardens along Heckel's curve, elastic inside.

        f = q^2/M^2 + (p + pt)(p - pc) <= 0,  associated flow,  dk/k = plastic volumetric strain
        pc(k) = ln[(1 - k0)/(1 - k)] / K_H * [1 + m ln(1 + rate/reference_rate)]

    p is the mean pressure and q the von Mises stress, compression positive; k is the density ratio. `rate` is the mean
    rate of compaction under the roller, `rolling_contact.compaction_rate`.

    Parameters
    ----------
    unloading_modulus : float
        Young's modulus of unloading and reloading E_u [Pa], > 0.
    poisson : float
        Poisson's ratio nu [-], 0 <= nu < 0.5.
    heckel_slope : float
        K_H of the isotropic curve [1/Pa], > 0; 1.10-1.19 times the one-dimensional one of mix tables.
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

    def __post_init__(self) -> None:
        moduli = "unloading_modulus heckel_slope loose_density_ratio critical_slope reference_rate"
        require_fields(self, positive=moduli, nonnegative="tensile_strength rate_sensitivity")
        _require_poisson(self.poisson)
        if not self.loose_density_ratio < self.fed_density_ratio < 1:
            raise ValueError(
                f"`fed_density_ratio` must lie between `loose_density_ratio` {self.loose_density_ratio!r} and 1, "
                f"got {self.fed_density_ratio!r}"
            )
        require_known("dry_side", self.dry_side, get_args(SubcriticalSide))

    def yield_pressure(self, density_ratio: ArrayLike) -> Array:
        """Compute the preconsolidation pressure pc(k) [Pa] at rest.

        Parameters
        ----------
        density_ratio : array_like
            Density ratio k [-], > 0.

        Notes
        -----
        Heckel's curve is used up to k = 0.99. Beyond, pc continues along the tangent of the curve over ln k, so that
        it stays finite and k may exceed 1 outside the range of validity. Near k0 pc tends to a small positive value.
        Both transitions are smooth.
        """
        k, k0 = np.asarray(density_ratio, dtype=float), self.loose_density_ratio
        curve = np.log((1 - k0) / (1 - np.minimum(k, HECKEL_MAX_DENSITY_RATIO)))
        stiffness = HECKEL_MAX_DENSITY_RATIO / (1 - HECKEL_MAX_DENSITY_RATIO)
        curve = curve + stiffness * np.log(np.maximum(k / HECKEL_MAX_DENSITY_RATIO, 1))
        level = np.expm1(2 * np.minimum(curve / HECKEL_MIN_PRESSURE - 1, 0)) * HECKEL_MIN_PRESSURE / 2
        return (np.maximum(curve, HECKEL_MIN_PRESSURE) + level) / self.heckel_slope

    def rate_factor(self, rate: float) -> float:
        """Return the factor 1 + m ln(1 + rate/reference_rate) of pc at a rate of compaction [1/s], >= 0."""
        return 1.0 + self.rate_sensitivity * float(np.log1p(rate / self.reference_rate))
