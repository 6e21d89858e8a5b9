"""What the mix does: linear elastic and viscoelastic materials in plane strain, one Poisson's ratio each."""

from dataclasses import dataclass

from compact.refuse import refuse_nonpositive


@dataclass(frozen=True)
class Elastic:
    """Isotropic linear elastic mix: `youngs_modulus` E [Pa] > 0, `poisson` nu, 0 <= nu < 0.5."""

    youngs_modulus: float
    poisson: float

    def __post_init__(self):
        refuse_nonpositive(youngs_modulus=self.youngs_modulus)
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
            refuse_nonpositive(stiffness_share=share, relaxation_time=time)

    @property
    def instant_modulus(self):
        """E(0) = E (1 + sum of shares) [Pa]."""
        return self.youngs_modulus * (1 + sum(share for share, _ in self.branches))

    def complex_modulus(self, frequency):
        """E (1 + sum share i w t/(1 + i w t)) [Pa] at the angular frequency w [rad/s]."""
        terms = (share * 1j * frequency * time / (1 + 1j * frequency * time) for share, time in self.branches)
        return self.youngs_modulus * (1 + sum(terms))
