"""Tables [process] and [sleeve]: what is refused, in which words, and what is advised."""

from pathlib import Path

import pytest

from compact.scene.loader import SceneError, load_scene, parse_scene, starter_scene

SCENE = Path(__file__).parents[2] / "studies" / "scenes" / "process.toml"
NO_CLOSURE = {"process.product_density_ratio": None}


def test_the_sample_scene_is_valid_and_advises_a_third_roller():
    scene = load_scene(SCENE)
    (advice,) = scene.advice
    assert advice.endswith(
        "machine.rollers: 2 rollers side by side, each over its own stroke, press rollers*(stroke - overlap) = 0.776 m "
        "of product.width = 1.164 m; the whole width needs machine.rollers = 3, or another cart"
    )
    three = {"machine.rollers": 3, "machine.roller_positions": [0.4, 0.0, -0.4]}
    assert load_scene(SCENE, **three).advice == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            NO_CLOSURE,
            "process.gap: exactly one of gap, product_density_ratio, extrusion_pressure must be given, got none",
        ),
        ({"process.gap": 0.001}, "must be given, got gap and product_density_ratio; take the others out"),
        ({"process.mould_speed": 0.0}, "process.mould_speed: is 0, and process.strokes is missing; give the number"),
        ({"process.strokes": 4}, "process.mould_speed: is 0.0175 m/s, so that roller length and stroke determine"),
        ({"process.mould_speed": 1.5}, "process.mould_speed: must be at most machine.roller_length over the time of a"),
        (
            {"process.mould_speed": 1e-5, "unusual": ["process.mould_speed"]},
            "process.mould_speed: must be at least 0.0001309 m/s, for 10000 strokes on a section",
        ),
        ({"product.mould_speed": 0.02}, "process.mould_speed: must be product.mould_speed = 0.02 m/s, got 0.0175"),
        ({"process.mould_speed": 17.5}, "was 17.5 mm/s = 0.0175 m/s meant?"),
        (
            {"process.fill_height": 0.2},
            "process.fill_height: process.fill_density_ratio is missing; give both, or neither",
        ),
        (
            {"process.fill_height": 0.23, "process.fill_density_ratio": 0.75},
            "process.fill_height: must be at most product.height + R (1 - cos nip) = 0.2266 m, got 0.23",
        ),
        (NO_CLOSURE | {"process.gap": 0.007}, "process.gap: must be at most R (1 - cos nip) = 0.006634 m, got 0.007"),
        (
            NO_CLOSURE | {"process.gap": 0.001, "process.feed": "even"},
            'process.gap: is for process.feed "room", got 0.001',
        ),
        ({"process.product_density_ratio": 0.74}, "must be above process.feed_density_ratio = 0.75, got 0.74"),
        (
            {"process.feed": "first"},
            'process.feed_count: is missing, and process.feed is "first"; give the number of fed',
        ),
        ({"process.feed_count": 3}, 'process.feed_count: is for process.feed "first", got it with "room"; take it out'),
        ({"process.feed": "table"}, 'process.feed_table: is missing, and process.feed is "table"; give points'),
        (
            {"process.feed": "table", "process.feed_table": [{"position": 2.0, "relative_thickness": 1.0}]},
            "process.feed_table: must have positions that rise one by one up to machine.roller_length = 1.164 m",
        ),
        (
            {"process.feed": "table", "process.feed_table": [{"position": 0.0, "relative_thickness": 0.0}]},
            "process.feed_table: must have one positive relative_thickness at least, got none",
        ),
        (
            {"process.offered_thickness": 0.001},
            "process.offered_thickness: is for process.extrusion_pressure, got 0.001",
        ),
        ({"process.feed": "all"}, "process.feed: must be one of room, even, first, table, got 'all'"),
        ({"process.nip_angle": 0.0}, "process.nip_angle: must be above 0 and at most 60, got 0"),
        ({"process.layers": 0}, "process.layers: must be between 1 and 500, got 0"),
        (
            {"process.feed_density_ratio": 0.7},
            "process.feed_density_ratio: must be above 0.72 and at most 0.99, got 0.7",
        ),
        ({"process": None}, "sleeve: is for the table [process], which is missing; take the table [sleeve] out"),
        ({"sleeve.head": -1.0}, "sleeve.head: must be positive, got -1"),
        ({"sleeve.wall_friction": 1.5}, "sleeve.wall_friction: must be between 0 and 1, got 1.5"),
    ],
)
def test_contradictions_are_refused_in_words(changes, words):
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, **changes)
    assert any(words in mistake for mistake in caught.value.mistakes), caught.value.mistakes


def test_the_tables_of_the_starter_are_valid_once_uncommented():
    text = starter_scene()
    start, end = text.index("# [process]"), text.index("\n[accuracy]") + 1
    lines = text[start:end].replace("\n# ", "\n").removeprefix("# ").split("\n")
    optional = ("strokes", "gap", "extrusion_pressure", "offered_thickness", "feed_count")
    kept = [line for line in lines if not line.startswith(optional)]
    table = "\n".join(kept)
    opened, closed = table.index("feed_table"), table.index("\n]\n") + 3
    scene = parse_scene(text.replace(text[start:end], table[:opened] + table[closed:] + "\n"))
    assert scene.process.feed == "room"
    assert scene.sleeve.count == 2
