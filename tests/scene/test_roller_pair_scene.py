"""Scene of a pair of rollers: what its contact reports beside the forces, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from compact.analysis.contact_cases import contact_inputs
from compact.analysis.stages.roller_pair import pair_answer
from compact.analysis.study import Study
from compact.engines.column.roller_pair import RollerPair
from compact.material.laws import Compaction
from compact.report import contact_tables, text
from compact.scene.loader import SceneError, load_scene

FILE = Path(__file__).parents[2] / "studies" / "scenes" / "roller-compactor.toml"
SPEED = 0.1


@pytest.fixture(scope="module")
def study():
    return Study(load_scene(FILE, **{"accuracy.engine": "column", "compare": None, "output.items": []}))


def test_columns_of_the_scene_keep_the_length_of_the_feed(study, tmp_path):
    passes = study.passes_at(SPEED)
    pair = pair_answer(study.scene, study.mix, passes[0], SPEED)
    assert pair.strip_thickness == pytest.approx(0.0025, rel=1e-6)
    assert (pair.strip_over_feed, pair.rim_over_feed) == (1.0, None)
    assert pair.gap < pair.strip_thickness  # by the elastic recovery
    assert pair.power == pytest.approx(2 * passes[0].resistance * SPEED * 0.05)
    digest = text.contact_digest(study, SPEED, passes)
    assert "one of two rollers: gap 2.4" in digest
    assert "Johanson: nip angle" in digest
    contact_tables.write_contact(tmp_path, study, SPEED, passes)
    written = json.loads((tmp_path / "contact.json").read_text("utf-8"))["pair"]
    assert written["gap"] == {"value": pair.gap, "unit": "m"}
    assert written["johanson_nip_angle"]["value"] == pair.johanson_nip_angle


def test_contact_of_one_roller_has_no_pair(study):
    single = study.scene.replaced(**{"machine.roller_condition": "free", "layer.base": "bonded"})
    assert pair_answer(single, study.mix, study.passes_at(SPEED)[0], SPEED) is None


def test_powder_of_johanson_has_the_slope_and_the_angles_of_the_mix():
    mix = Compaction(1e9, 0.2, 1e-8, 0.5, np.sqrt(3) * np.sin(np.radians(40)), 1e-3, 0.6, heckel_test="confined")
    pair = RollerPair.of_mix(mix, 0.1, 0.004, 0.8, np.tan(np.radians(20)))
    stress = np.log(0.5 / (1 - np.array([0.6, 0.8])))  # of Heckel's curve, over its slope
    slope = np.log(stress[1] / stress[0]) / np.log(0.8 / 0.6)
    assert pair.compressibility == pytest.approx(slope, rel=0.05)  # elastic strain
    assert pair.effective_friction_angle == pytest.approx(40)
    assert pair.wall_friction_angle == pytest.approx(20)


def test_finite_elements_get_the_pair_of_the_scene():
    scene = load_scene(FILE)
    layer, roller, _ = contact_inputs(scene, Study(scene).mix, "compaction", SPEED)
    assert (layer.base, roller.rolling, roller.profile) == ("slip", "pair", "deformed")
    assert scene.replacements["column"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"layer.base": "bonded"}, 'roller_condition: "pair" needs layer.base = "slip"'),
        ({"mix.overrides.steel_friction": 0.0}, 'roller_condition: "pair" needs friction'),
        (
            {"layer.lower_lift": {"thickness": 0.06, "density_ratio": 0.95}},
            'roller_condition: "pair" has no lower lift',
        ),
        ({"machine.roller_torque": 5.0}, 'roller_torque: is for machine.roller_condition "free" or "driven"'),
        ({"accuracy.engine": "fem"}, 'roller_condition: the engine "fem" takes no "pair"'),
        ({"machine.roller_condition": "free"}, 'base: the engine "column" takes no "slip"'),
    ],
)
def test_a_scene_that_is_no_pair_is_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        load_scene(FILE, **changes)
