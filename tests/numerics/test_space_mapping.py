"""Space mapping: closed forms, noisy and failing fine models, data that do not determine the unknowns."""

import numpy as np
import pytest

from compact.numerics.space_mapping import fit_parameters


def test_slope_of_the_correction_converges():
    """A constant correction of u by u^2.5 would overshoot more at each step."""
    found = fit_parameters(np.exp, [6.0], [0.0], lambda u: np.exp(2.5 * u))
    assert found.unknowns == pytest.approx([np.log(6.0) / 2.5], abs=1e-3)
    assert found.correction.slope == pytest.approx(np.array([[1.5]]), rel=0.02)
    assert found.sensitivity == pytest.approx(np.array([[1 / 2.5]]), rel=0.02)
