"""The scene of `compact new`: what is derived, what a wrong option gets, and the engine that "auto" chooses."""

import re
from types import SimpleNamespace

import pytest

from compact.api.scene import Scene
from compact.cli import program as cli
from compact.files import published_scenes
from compact.scene.loader import load_scene, parse_scene
from compact.scene.new_scene import new_scene, published_scene, starter_scene

PLATE = {
    "rollers": 3, "diameter": 0.18, "plate": (0.9, 0.9, 0.1), "stroke": 0.3, "duration": 1.2, "mass": 650.0,
    "moisture": 0.09,
}  # fmt: skip
OPTIONS = (
    "--rollers", "3", "--diameter", "0.18", "--plate", "0.9x0.9x0.1", "--stroke", "0.3", "--duration", "1.2",
    "--mass", "650", "--moisture", "0.09",
)  # fmt: skip


def test_without_options_it_is_the_template():
    assert new_scene({}) == (starter_scene(), [])


def test_positions_widths_weight_and_lift_follow_from_the_options():
    text, derived = new_scene(PLATE)
    scene = parse_scene(text)
    machine = scene.machine
    assert machine.roller_positions == (0.3, 0.0, -0.3)
    assert (machine.weight, machine.feeder_sleeve, machine.overlap) == (6376.5, 0.12, 0.0)
    assert machine.feeder_sleeve + 2 * machine.roller_radius == scene.motion.stroke
    assert scene.lift_thickness == 0.03
    assert (scene.mix.values, scene.mix.fitted_at, scene.accuracy.engine) == ({}, None, "compaction")
    assert all(scene.is_marked(line.partition(" ")[0], line.split(": ")[1]) for line in derived)
    assert scene.is_marked("machine.mass", "given")
    assert not any("guess" in line for line in text.split("\n") if "given" in line or "derived" in line)


def test_width_over_the_stroke_gives_the_number_of_rollers():
    text, derived = new_scene({name: value for name, value in PLATE.items() if name != "rollers"})
    assert parse_scene(text).machine.rollers == 3
    assert "machine.rollers = 3: derived: the width over the stroke" in derived


def test_a_density_ratio_moves_that_of_the_feed():
    scene = parse_scene(new_scene({"density_ratio": 0.92})[0])
    assert scene.layer.fed_density_ratio == pytest.approx(0.72 + 0.846 * 0.2, abs=1e-9)


WRONG = {
    "millimetres": (("--diameter", "180"), "was 90 mm = 0.09 m meant?"),
    "plate in millimetres": (("--plate", "900x900x100"), "mm = 0.9 m meant?"),
    "comma in the plate": (("--plate", "0,9x0,9x0,1"), "such as 0.9x0.9x0.1, got '0,9x0,9x0,1'"),
    "two lengths": (("--plate", "0.9x0.1"), "--plate takes WIDTHxLENGTHxHEIGHT in m"),
    "swapped stroke and duration": (
        ("--stroke", "1.2", "--duration", "0.3"),
        "are motion.stroke and motion.duration swapped? Give 0.3 m and 1.2 s",
    ),
    "short stroke": (("--stroke", "0.1"), "shorter than a roller of 0.18 m (eq 1.2); give a longer --stroke"),
    "too many rollers": (("--rollers", "9"), "9 rollers of 0.18 m do not fit side by side on 0.9 m; give --rollers 5"),
    "too few rollers": (("--rollers", "1"), "give --stroke 0.9 to 1.8 or another --rollers"),
    "tonnes": (("--mass", "0.65"), "was 0.65 t = 650 kg meant?"),
    "unknown published scene": (("--from", "loveikin"), "--from takes the name of a published scene"),
    "both": (("--from", "loveikin-2015"), "leave the other options out"),
}


@pytest.mark.parametrize(("wrong", "words"), WRONG.values(), ids=WRONG)
def test_a_wrong_option_gets_a_sentence_with_a_remedy(wrong, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    options = dict(zip(OPTIONS[::2], OPTIONS[1::2], strict=True)) if words[:6] != "--from" else {}
    options |= dict(zip(wrong[::2], wrong[1::2], strict=True))
    assert cli._exit_code(["new", "mine", *(word for pair in options.items() for word in pair)]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == (3 if "x" in wrong[1] and "mm" in words else 1)  # lengths of the plate
    assert not (tmp_path / "mine").exists()


def asked(monkeypatch, answers):
    """Answer the questions of a terminal; return those asked."""
    told, given = [], iter(answers)

    def answer(question):
        told.append(question)
        found = next(given)
        return found if isinstance(found, str) else raising(found)

    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))
    return told


def raising(error):
    raise error


@pytest.mark.parametrize("answers", [("3", "0.18", "0.9x0.9x0.1", "0.3", "1.2", "650", "0.09", ""), ("",) * 8])
def test_questions_write_the_scene_of_the_options(answers, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    told = asked(monkeypatch, answers)
    assert cli._exit_code(["new", "mine"]) == 0
    assert [each.partition(",")[0] for each in told] == [*PLATE, "density_ratio"]
    assert all(re.search(r", .+ \[.+\]: $", each) for each in told)
    text, derived = new_scene(PLATE if any(answers) else {})
    assert (tmp_path / "mine" / "scene.toml").read_text() == text
    assert all(line in capsys.readouterr().out.split("\n") for line in derived[:1])


def test_a_wrong_answer_gets_the_refusal_of_its_option_and_the_question_again(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    again = ("3", "", "", "0.3", "1.2", "", "", "")  # swapped before, which is found at the end; Enter keeps the others
    told = asked(
        monkeypatch, ("3", "180", "0.18", "0.9x0.9", "0.9x0.9x0.1", "1.2", "0.3", "650", "9 %", "0.09", "", *again)
    )
    assert cli._exit_code(["new", "mine"]) == 0
    said = capsys.readouterr().err
    for words in ("was 90 mm = 0.09 m meant?", "such as 0.9x0.9x0.1, got '0.9x0.9'", "give a plain number", "swapped?"):
        assert words in said
    assert told[1] == told[2]
    assert told[12] == "diameter, of a roller, m [0.18]: "
    assert (tmp_path / "mine" / "scene.toml").read_text() == new_scene(PLATE)[0]


def test_an_interrupted_question_writes_nothing(tmp_path, monkeypatch, capsys):
    asked(monkeypatch, ("3", KeyboardInterrupt()))
    assert cli._exit_code(["new", str(tmp_path / "mine")]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", [name for name in published_scenes() if "printed" not in name])
def test_published_scenes_are_read_and_copied_by_name(name):
    copied = parse_scene(published_scene(name))
    assert copied == load_scene(name)
    assert re.match("#:schema", published_scene(name))


# the engine of "auto"

FIT = {"moisture": 0.09, "density_ratio": 0.98, "parameters": ["heckel_slope", "fed_density_ratio"]}


@pytest.mark.parametrize(
    ("changes", "engine", "words"),
    [
        ({}, "compaction", "column has no fit to forces of a roller"),
        ({"layer.lift_thickness": 0.1}, "compaction", "column has no bow wave, layer 3.6 contact lengths high"),
        ({"mix.overrides.heckel_slope": 1e-5, "mix.fitted_at": FIT}, "column", "the cheapest that may size this scene"),
        ({"mix.overrides.heckel_slope": 1e-5, "mix.fitted_at": FIT, "layer.base": "slip"}, "compaction", "layer.base"),
        (
            {"mix.overrides.heckel_slope": 1e-5, "mix.fitted_at": FIT | {"engine": "compaction"}},
            "compaction",
            "no fit to",
        ),
    ],
)
def test_auto_takes_the_cheapest_valid_engine_and_names_the_reason(changes, engine, words):
    scene = parse_scene(new_scene(PLATE)[0]).replaced(**changes | {"accuracy.engine": "auto"})
    assert scene.accuracy.engine == engine
    assert words in scene.replacements[engine][0]
    assert scene.replaced(**{"mix.moisture": 0.1}).accuracy.engine == engine
    assert scene.hash == scene.replaced(**{"accuracy.engine": engine}).hash


@pytest.mark.slow
@pytest.mark.parametrize(("lift", "fed", "share"), [(0.0075, 0.94, 0.63), (0.015, 0.94, 0.47), (0.0075, 0.85, 0.62)])
def test_columns_without_a_fit_have_a_part_of_the_resistance(lift, fed, share):
    changes = {"layer.lift_thickness": lift, "layer.fed_density_ratio": fed, "mix.moisture": 0.10, "output.items": []}
    scene = Scene.parse(new_scene(PLATE)[0]).replaced(**changes)
    columns, elements = (scene.roll(0.25, engine=engine)[0] for engine in ("column", "compaction"))
    assert columns.resistance / elements.resistance == pytest.approx(share, abs=0.03)
    assert lift / columns.contact_length < 1.3  # within the limit of columns with a fit, 2
