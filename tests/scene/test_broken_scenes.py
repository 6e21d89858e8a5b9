"""Random broken or extreme scenes: an answer that meets what was prescribed, or a refusal in plain words, in time.

Each case takes the new or the small scene, changes up to three keys of the schema (wrong types, signs and sizes, nan,
contradictions), prescribes a target or none, and calls a command that computes. It runs in a child process, which a
limit of processor time ends.
"""

import json
import math
import random
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from extreme_scenes import DRIVES, Case, at, choices, ended, keys, toml

from compact.cli import program as cli
from compact.scene import plausible_ranges
from compact.scene.loader import load_scene, read_change
from compact.scene.new_scene import starter_scene

SMALL = Path(__file__).parents[2] / "compact" / "data" / "scenes" / "small.toml"
SECONDS = 10  # of processor time for one case
ENGINES = ("formula", "formula", "column", "column", "column", "spectral", "spectral", "fem")
TARGETS = {"contact.load": (50.0, 1e5), "contact.peak_pressure": (1e3, 2e6), "contact.indentation": (1e-4, 0.1)}
ODD = (0, -1, 1e-300, 1e300, 1e-9, 1e9, nan, inf, -inf, "x", "", True, [], [nan], {}, {"x": 1}, 10**400)
FINEST = 2e-3  # [-], tolerance at which `fem` answers within the limit; 1e-3 of a slow contact takes 15 s
FORBIDDEN = ("Traceback", "internal error", "encountered in", "RuntimeWarning", "at index", "nan at", "Singular matrix")
SHORT = {"motion.laws": ["cubic"], "output.items": [], "contact.speeds": [0.05, 0.2], "accuracy.tolerance": 0.05}
TIED = (  # keys that seldom change alone
    "machine.rollers", "machine.roller_positions", "machine.guide_positions", "machine.feeder_sleeve", "drive.carts",
    "drive.rank_by", "motion.energy_weight", "motion.acceleration_weight", "motion.laws", "output",
    "title", "layer.base",
)  # fmt: skip
FELT = (  # keys that engines feel
    "machine.roller_radius", "machine.roller_length", "product.height", "layer.lift_thickness",
    "layer.fed_density_ratio", "motion.duration", "accuracy.tolerance",
)  # fmt: skip
KEYS = keys()


def odd(draw, key):
    """A value of a wrong type, sign or size, or another word."""
    words = choices(KEYS[key])
    if words and draw.random() < 0.3:
        word = draw.choice(words)
        return [word] if key.endswith(("laws", "output.items", "rank_by", "objectives", "spread")) else word
    return draw.choice(ODD)


def extreme(draw, key, given):
    """A value of the right type: within the plausible range or up to 300 times beyond it, or far from the one given."""
    if key in plausible_ranges.COMPARED_KEYS:
        found, beyond = plausible_ranges.range_of(key), draw.choice((1, 1, 3, 30, 300))
        value = math.exp(draw.uniform(math.log(found.low / beyond), math.log(found.high * beyond)))
        if isinstance(given, tuple):
            return [value * entry for entry in given] if max(map(abs, given)) < 1 else [value]
        return max(1, round(value)) if isinstance(given, int) else value
    if isinstance(given, int | float) and not isinstance(given, bool):
        scaled = given * 10 ** draw.uniform(-2, 2)
        return max(1, round(scaled)) if isinstance(given, int) else scaled
    return odd(draw, key) if choices(KEYS[key]) else given


def case(seed):
    """The case of a number: half of them are odd, half are valid tables with extreme numbers."""
    draw = random.Random(seed)
    scene, command = draw.choice(("new", "small")), draw.choice(("roll", "roll", "roll", "run", "run", "sweep"))
    engine = draw.choice(ENGINES if command != "run" else ("formula", "formula", "column", "spectral"))
    changes: dict[str, Any] = dict(SHORT) if command == "run" else {}
    if draw.random() < 0.5:
        key = draw.choice(tuple(TARGETS)[: 2 if engine == "formula" else 3])
        low, high = TARGETS[key]
        changes[key] = math.exp(draw.uniform(math.log(low), math.log(high)))
    deep = draw.random() < 0.7
    tables = load_scene("small").model_dump()
    if deep and command == "run":
        name = draw.choice(tuple(DRIVES))
        changes |= DRIVES[name]
        for key, value in DRIVES[name].items():
            part = tables
            *path, last = key.split(".")
            for each in path:
                part = part[each]
            part[last] = value
    likely = [key for key in KEYS if at(tables, key) is not None and not key.startswith(("mix.", *TIED))]
    likely = draw.choice((likely, [key for key in KEYS if key.startswith("mix.") or key in FELT]))
    for key in draw.sample(likely if deep else tuple(KEYS), draw.choice((1, 1, 2, 3) if deep else (1, 3, 5, 7))):
        value = extreme(draw, key, at(tables, key)) if deep else odd(draw, key)
        if value is not None and key not in changes:
            changes[key] = value
    if engine == "fem" and isinstance(changes.get("accuracy.tolerance"), float):  # its work grows without bound
        changes["accuracy.tolerance"] = max(changes["accuracy.tolerance"], FINEST)
    if not deep and draw.random() < 0.2:
        changes[draw.choice(("machine.roler_radius", "nothing", "mix.overrides.poison", "contact.depth"))] = 0.1
    named = [key for key in plausible_ranges.COMPARED_KEYS if any(key.startswith(change) for change in changes)]
    if named and draw.random() < (0.8 if deep else 0.2):
        changes["unusual"] = named
    options = ()
    if command == "roll" and draw.random() < 0.4:
        speeds = (0.1, -0.1, 1.0, 1e-3, 30.0) if deep else (0.0, 1e6, 1e-12, math.nan, math.inf)
        options = ("--speed", repr(draw.choice(speeds)))
    if command == "sweep":
        load = () if set(TARGETS) & set(changes) else ("contact.load=5000,50000",)
        vary = draw.choice(("mix.moisture=0.09,0.11", "mix.density_ratio=0.95,0.98", *load))
        options = ("--vary", vary, "--workers", "1")
    return Case(scene, command, engine, changes, options)


def met(asked, contact, scene):
    """What a contact misses of what the scene prescribes, in words; empty where it misses nothing."""
    of = {name: contact[name]["value"] for name in ("load", "resistance", "peak_pressure", "indentation")}
    wanted = {} if scene.contact is None else scene.contact.model_dump(exclude={"speeds"}, exclude_none=True)
    of["load"] *= scene.machine.roller_length
    numbers = [of["load"], of["resistance"], of["peak_pressure"]]
    if not all(isinstance(each, float) and math.isfinite(each) for each in numbers) or of["load"] <= 0:
        return f"numbers {of}"
    allowed = max(scene.accuracy.tolerance, 1e-6)
    missed = [f"{name} {of[name]} for {value}" for name, value in wanted.items() if abs(of[name] / value - 1) > allowed]
    if scene.accuracy.engine in ("spectral", "fem"):  # which are given the tolerance, and estimate their errors
        errors = [contact[name]["error"] for name in ("load", "resistance")]
        if any(error is None or not error <= scene.accuracy.tolerance for error in errors):
            missed.append(f"errors {errors} for {scene.accuracy.tolerance}")
    if not wanted and "exit_density_ratio" in contact:
        left = contact["exit_density_ratio"]["value"]
        missed += [f"density {left}"] if abs(left - scene.mix.density_ratio) > 0.01 else []
    return "; ".join(missed)


def faults(asked, folder):
    """What is wrong with how a case ended, in words; empty where nothing is."""
    outcome = ended(asked, folder, SECONDS)
    if outcome.code not in (0, 1, 2):
        return f"ended by {outcome.code} after {outcome.seconds:.0f} s: {outcome.said[-300:]}"
    raw = [word for word in FORBIDDEN if word in outcome.said]
    if raw:
        return f"raw words {raw}: {outcome.said[-400:]}"
    if outcome.code:
        return "" if len(outcome.said.split()) > 5 else f"says too little: {outcome.said!r}"
    changes = dict(read_change(f"{key}={toml(value)}") for key, value in asked.changes.items())
    scene = load_scene(folder / f"{asked.scene}.toml", **changes | {"accuracy.engine": asked.engine})
    if asked.command == "roll":
        return met(asked, json.loads((folder / "out" / "contact.json").read_text()), scene)
    if asked.command == "run":
        summary = json.loads((folder / "out" / "summary.json").read_text())
        wrong = [met(asked, contact, scene) for contact in summary["contacts"]]
        wrong += [name for name, number in summary["numbers"].items() if number["value"] in (None, "infinite")]
        if asked.engine == "formula" and scene.contact is not None and scene.contact.load:
            force = summary["numbers"]["roller_force"]["value"]
            wrong += [f"roller force {force}"] if abs(force / scene.contact.load - 1) > 1e-6 else []
        return "; ".join(filter(None, wrong))
    return swept(scene, folder / "out" / "sweep.nc")


def swept(scene, path):
    from compact.sweep.run import read_sweep

    table, wrong = read_sweep(path), []
    for load, reason in zip(table["load"].values.ravel(), table["reason"].values.ravel(), strict=True):
        if any(word in reason for word in FORBIDDEN):
            wrong.append(f"raw reason: {reason}")
        if not reason and not (math.isfinite(load) and load > 0):
            wrong.append(f"load {load} without a reason")
    if "load" in table.coords or "contact_load" in table.coords:
        for asked, load in zip(table["contact_load"].values, table["load"].values, strict=True):
            if math.isfinite(load) and abs(load / asked - 1) > max(scene.accuracy.tolerance, 1e-6):
                wrong.append(f"load {load} for {asked}")
    return "; ".join(wrong)


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """Load what the engines need once, in the process from which the cases are forked."""
    folder = tmp_path_factory.mktemp("warm")
    for engine in dict.fromkeys(ENGINES):
        assert cli._exit_code(["roll", str(SMALL), "--engine", engine, "--out", str(folder / engine), "--quiet"]) == 0
    compiled = DRIVES["elastic"] | {"output.items": [], "motion.laws": ["cubic"]}
    changes = [f"--set={key}={json.dumps(value)}" for key, value in compiled.items()]
    assert cli._exit_code(["run", str(SMALL), *changes, "--out", str(folder / "elastic"), "--quiet"]) == 0


def checked(asked, folder):
    (folder / "new.toml").write_text(starter_scene())
    (folder / "small.toml").write_text(SMALL.read_text("utf-8"))
    assert not (wrong := faults(asked, folder)), f"{wrong}\ncompact {' '.join(map(repr, asked.arguments))}"


@pytest.mark.parametrize("seed", range(6))
def test_a_broken_scene_is_solved_or_refused(seed, tmp_path, warm):
    checked(case(seed), tmp_path)


@pytest.mark.parametrize(
    "seed",
    [
        *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 80)),
        *(pytest.param(seed, marks=pytest.mark.nightly) for seed in range(80, 340)),
    ],
)
def test_many_broken_scenes_are_solved_or_refused(seed, tmp_path, warm):
    checked(case(seed), tmp_path)


@pytest.mark.parametrize("seed", range(400, 403))
def test_a_scene_outside_the_range_of_compaction_is_refused(seed, tmp_path, warm):
    """A contact by `compaction` takes minutes, so that every case has a mistake."""
    asked = case(seed)
    checked(asked._replace(engine="compaction", changes=asked.changes | {"nothing": 0.1}), tmp_path)


# the harness itself
