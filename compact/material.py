"""What one streamline of the mix does. So far: linear elastic."""

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
