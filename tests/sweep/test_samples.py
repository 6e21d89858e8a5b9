"""Samples of a sweep: Sobol indices against closed forms, ranges and grids, refusals."""

import numpy as np
import pytest
from scipy.stats import qmc

from compact.material import mix
from compact.scene.loader import load_scene
from compact.sweep import design as vary
from compact.sweep.sobol_indices import Index, indices

ISHIGAMI_A, ISHIGAMI_B = 7.0, 0.1


def ishigami(x):
    return np.sin(x[0]) + ISHIGAMI_A * np.sin(x[1]) ** 2 + ISHIGAMI_B * x[2] ** 4 * np.sin(x[0])


def ishigami_indices():
    """First order and total, T. Ishigami and T. Homma 1990, by integration."""
    a, b, pi = ISHIGAMI_A, ISHIGAMI_B, np.pi
    variance = a**2 / 8 + b * pi**4 / 5 + b**2 * pi**8 / 18 + 0.5
    first = np.array([0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, 0.0]) / variance
    together = 8 * b**2 * pi**8 / 225 / variance
    return first, first + np.array([together, 0.0, together])


def rows(function, inputs, n, low=0.0, high=1.0):
    """f_A, f_B, f_AB of a function of x, shape (inputs, n), uniform between low and high."""
    shares = low + (high - low) * qmc.Sobol(2 * inputs, seed=1).random(n)
    A, B = shares[:, :inputs].T, shares[:, inputs:].T
    mixed = [np.where(np.arange(inputs)[:, None] == i, B, A) for i in range(inputs)]
    return [function(A), function(B), *(function(x) for x in mixed)]


def estimated(values):
    """Indices with arrays over the inputs."""
    return Index(*np.array(indices(values)).T)


def is_covered(found, first, total):
    return np.all(
        (found.first_low <= first)
        & (first <= found.first_high)
        & (found.total_low <= total)
        & (total <= found.total_high)
    )


def test_ishigami_lies_within_confidence_bounds_that_narrow_with_the_root_of_the_rows():
    found = {n: estimated(rows(ishigami, 3, n, -np.pi, np.pi)) for n in (256, 1024, 4096)}
    assert all(is_covered(each, *ishigami_indices()) for each in found.values())
    wide, narrow = (found[n].first_high - found[n].first_low for n in (256, 4096))
    assert narrow == pytest.approx(wide / 4, rel=0.25)
    assert np.all(narrow < 0.07)


def test_product_has_its_closed_form():
    """f = prod (1 + c_i (2 x_i - 1)): V_i = c_i^2/3, V = prod (1 + V_i) - 1."""
    shares = np.array([1.0, 0.5, 0.2])
    parts = shares**2 / 3
    variance = np.prod(1 + parts) - 1
    found = estimated(rows(lambda x: np.prod(1 + shares[:, None] * (2 * x - 1), axis=0), 3, 2048))
    assert is_covered(found, parts / variance, parts * np.prod(1 + parts) / (1 + parts) / variance)


def test_an_input_of_no_influence_and_a_single_one():
    f_A, f_B, first, *_ = rows(lambda x: x[0], 2, 128)
    explained, none = indices([f_A, f_B, first, f_A])
    assert none[:6] == pytest.approx(np.zeros(6), abs=1e-12)
    assert indices([f_A, f_B, first]) == [explained]
    assert explained.first == pytest.approx(1.0, abs=0.03)
    assert indices(np.full((3, 16), 0.1)) == [(0.0,) * 6 + (16,)]


# ---- Design of a sweep: grids, lists and samples; refusals before any computation


SCENE = load_scene("loveikin-2015")
PRIOR = SCENE.replaced(**{"mix.overrides.effective_modulus": None})


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("mix.moisture=0.08:0.12:5", (0.08, 0.09, 0.10, 0.11, 0.12)),
        ("layer.passes=1:3:3", (1, 2, 3)),
        ("machine.mass=1:2:3", (1.0, 1.5, 2.0)),
        ("machine.roller_condition = free, sliding", ("free", "sliding")),
        ("machine.one_sided=true,false", (True, False)),
        ("mix.moisture=0.1", (0.1,)),
    ],
)
def test_grids_and_lists_are_read(text, values):
    axis = vary.read_design(text)
    assert axis.values == values
    assert [type(value) for value in axis.values] == [type(value) for value in values]


def test_sample_covers_the_spread_and_stays_inside():
    scene = PRIOR.replaced(**{"accuracy.engine": "column", "mix.moisture": 0.09})
    design = vary.design(scene, [vary.read_design("mix.overrides=~64")])
    names = ("unloading_modulus", "poisson", "friction_angle", "cohesion", "heckel_slope", "saturation_limit")
    assert design.names == (*names, "rate_sensitivity")
    slope = mix.prior(0.09, 0.98).parameter("heckel_slope")
    drawn = [change.of(scene).mix.overrides for change in design.changes]
    values = np.array([each.heckel_slope for each in drawn])
    assert (slope.low < values).all()
    assert (values < slope.high).all()
    # a factor is sampled in logarithm: the mean logarithm of Sobol points is that of the value
    assert np.log(values).mean() == pytest.approx(np.log(slope.value), abs=0.01)
    poisson = np.array([each.poisson for each in drawn])
    assert poisson.mean() == pytest.approx(mix.prior(0.09, 0.98).poisson, abs=0.002)


def test_sample_follows_the_spread_of_each_mix():
    design = vary.design(
        PRIOR, [vary.read_design("mix.moisture=0.08,0.12"), vary.read_design("mix.overrides.required_pressure=~2")]
    )
    dry, wet = (design.changes[index].of(PRIOR).mix.overrides.required_pressure for index in (0, 2))
    expected = [mix.prior(moisture, 0.98).required_pressure for moisture in (0.08, 0.12)]
    assert dry / wet == pytest.approx(expected[0] / expected[1])


def test_rows_for_indices_change_one_input_each():
    design = vary.design(PRIOR, [vary.read_design("mix.overrides=~4")], indices=True)
    parts = np.array(design.parts)
    first, second = design.shares[parts == "A"], design.shares[parts == "B"]
    assert not np.any(first == second)
    for i, name in enumerate(design.names):
        mixed = design.shares[parts == name]
        assert np.array_equal(mixed[:, i], second[:, i])
        assert np.array_equal(np.delete(mixed, i, axis=1), np.delete(first, i, axis=1))


# refusals


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (("mix.moisture",), "--vary takes KEY=LOW:HIGH:N"),
        (("mix.moisture=0.1:0.08:5",), "runs from LOW up to HIGH in N >= 2 values, got 0.1:0.08:5"),
        (("mix.overrides=~6",), "powers of 2, got 6; give ~8"),
        ((), "nothing to vary"),
        (("mix.moisture=0.1", "mix.moisture=0.11"), "given twice"),
        (("output.items=tables",), "decides no number"),
        (("mix.overrides.effective_modulus=~8",), "is given, so it has no spread to sample"),
        (("mix.overrides.poisson=~8", "mix.overrides.steel_friction=~16"), "all samples share their points"),
        (("mix.moisture=0.08:0.12:1000000000",), r"at most 1000000 points, got \d{7,}; sample"),
    ],
)
def test_invalid_variation_is_refused_before_any_point_is_built(texts, words):
    with pytest.raises(ValueError, match=words):
        vary.design(SCENE, [vary.read_design(text) for text in texts])
