"""Design of a sweep: grids, lists and samples; refusals before any computation."""

import numpy as np
import pytest

from compact.material import mix
from compact.scene.loader import load_scene
from compact.sweep import design as vary

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
        (("mix.moisture=0.08:0.12:1000000000",), r"got \d{7,}; take a coarser grid"),
    ],
)
def test_invalid_variation_is_refused_before_any_point_is_built(texts, words):
    with pytest.raises(ValueError, match=words):
        vary.design(SCENE, [vary.read_design(text) for text in texts])
