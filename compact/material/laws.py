"""What the mix does: linear elastic, viscoelastic, or compacting for good; one Poisson's ratio each."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from compact.numerics.validation import require_known, require_nonnegative, require_positive

HECKEL_MAX_DENSITY_RATIO = (
    0.99  # density ratio where measured curves end; beyond, pc keeps the curve's modulus k dpc/dk
)
HECKEL_MIN_PRESSURE = 0.01  # K_H pc below which pc no longer falls along the curve but levels off at half of it


@dataclass(frozen=True)
class Elastic:
    """Isotropic linear elastic mix: `youngs_modulus` E [Pa] > 0, `poisson` nu, 0 <= nu < 0.5."""

    youngs_modulus: float
    poisson: float

    def __post_init__(self):
        require_positive(youngs_modulus=self.youngs_modulus)
        if not 0 <= self.poisson < 0.5:
            raise ValueError(f"`poisson` must lie in [0, 0.5), got {self.poisson!r}")

    @property
    def contact_modulus(self):
        """E* = E/(1 - nu^2) [Pa] under a rigid roller in plane strain."""
        return self.youngs_modulus / (1 - self.poisson**2)


@dataclass(frozen=True)
class Viscoelastic(Elastic):
    """Prony series on the fully relaxed modulus: E(t) = E [1 + sum_i share_i exp(-t/time_i)].

    `branches` are pairs (stiffness share > 0, relaxation time [s] > 0) beside the `youngs_modulus` E [Pa].

    >>> mix = Viscoelastic(10e6, 0.3, branches=((1.0, 0.1),))
    >>> mix.instant_modulus, abs(mix.complex_modulus(10.0))
    (20000000.0, 15811388.300841896)
    """

    branches: tuple[tuple[float, float], ...] = ()

    def __post_init__(self):
        super().__post_init__()
        if not all(len(branch) == 2 for branch in self.branches):
            raise ValueError(f"`branches` must be pairs (stiffness share, relaxation time), got {self.branches!r}")
        for share, time in self.branches:
            require_positive(stiffness_share=share, relaxation_time=time)

    @property
    def instant_modulus(self):
        """E(0) = E (1 + sum of shares) [Pa]."""
        return self.youngs_modulus * (1 + sum(share for share, _ in self.branches))

    def complex_modulus(self, frequency):
        """E (1 + sum share i w t/(1 + i w t)) [Pa] at the angular frequency w [rad/s]."""
        terms = (share * 1j * frequency * time / (1 + 1j * frequency * time) for share, time in self.branches)
        return self.youngs_modulus * (1 + sum(terms))


@dataclass(frozen=True)
class Compaction:
    """Mix that compacts for good: an elliptic cap that hardens along Heckel's curve, elastic inside.

        f = q^2/M^2 + (p + pt)(p - pc) <= 0,  associated flow,  dk/k = plastic volume strain,
        pc(k) = ln[(1 - k0)/(1 - k)] / K_H * (speed/reference_speed)^m

    p mean pressure, q von Mises stress, compression positive; k density ratio.

    unloading_modulus : E_u of unloading and reloading [Pa];  poisson : nu
    heckel_slope : K_H of the isotropic curve [1/Pa], 1.10-1.19 times the one-dimensional one of mix tables
    loose_density_ratio : k0, where Heckel's curve starts, a constant of the curve
    critical_slope : M = q/(p + pt) at constant volume;  tensile_strength : pt [Pa]
    fed_density_ratio : k of the mix in front of the roller, between k0 and 1
    rate_exponent, reference_speed : m and the speed [m/s] at which K_H holds; m = 0 is a mix that knows no rate
    dry_side : where p < (pc - pt)/2 the yield limit is the "ellipse", whose flow dilates, or "flat": q = M (pc + pt)/2
        down to p = 0, then a quarter ellipse to -pt, and pc remembers the largest k
    """

    unloading_modulus: float
    poisson: float
    heckel_slope: float
    loose_density_ratio: float
    critical_slope: float
    tensile_strength: float
    fed_density_ratio: float
    rate_exponent: float = 0.0
    reference_speed: float | None = None
    dry_side: Literal["ellipse", "flat"] = "flat"

    def __post_init__(self):
        require_positive(
            unloading_modulus=self.unloading_modulus,
            heckel_slope=self.heckel_slope,
            loose_density_ratio=self.loose_density_ratio,
            critical_slope=self.critical_slope,
        )
        require_nonnegative(tensile_strength=self.tensile_strength, rate_exponent=self.rate_exponent)
        if not 0 <= self.poisson < 0.5:
            raise ValueError(f"`poisson` must lie in [0, 0.5), got {self.poisson!r}")
        if not self.loose_density_ratio < self.fed_density_ratio < 1:
            raise ValueError(
                f"`fed_density_ratio` must lie between `loose_density_ratio` {self.loose_density_ratio!r} and 1, "
                f"got {self.fed_density_ratio!r}"
            )
        require_known("dry_side", self.dry_side, ("ellipse", "flat"))
        if self.rate_exponent:
            if self.reference_speed is None:
                raise ValueError("`reference_speed` must be given where `rate_exponent` is not 0, got None")
            require_positive(reference_speed=self.reference_speed)

    def yield_pressure(self, density_ratio):
        """pc(k) [Pa] under hydrostatic pressure at the reference speed, for any k > 0.

        Heckel's curve up to k = 0.99; there it would soon be a wall at k = 1, where no number is left to tell pc, so
        it goes on along its tangent over ln k and k may pass 1: a mix pressed beyond what the law knows. Near k0 pc
        levels off above 0. Both joints are smooth.
        """
        k, k0 = np.asarray(density_ratio, dtype=float), self.loose_density_ratio
        curve = np.log((1 - k0) / (1 - np.minimum(k, HECKEL_MAX_DENSITY_RATIO)))
        curve = curve + HECKEL_MAX_DENSITY_RATIO / (1 - HECKEL_MAX_DENSITY_RATIO) * np.log(
            np.maximum(k / HECKEL_MAX_DENSITY_RATIO, 1)
        )
        level = np.expm1(2 * np.minimum(curve / HECKEL_MIN_PRESSURE - 1, 0)) * HECKEL_MIN_PRESSURE / 2
        return (np.maximum(curve, HECKEL_MIN_PRESSURE) + level) / self.heckel_slope

    def rate_factor(self, speed):
        """(|speed|/reference_speed)^m, by which pc is larger at a speed [m/s]."""
        return (abs(speed) / self.reference_speed) ** self.rate_exponent if self.rate_exponent else 1.0
