"""Ensembles: closed forms of the formulas under changes, and reasons."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from compact.analysis.stages.drives import build_stages
from compact.analysis.stages.ensemble import Change, drive_peaks, ensemble, first_law
from compact.analysis.worker_pool import ProcessExecutor
from compact.resistance import dry_resistance
from compact.scene.loader import load_scene

SMALL = load_scene("small", **{"output.items": []})
LAWS = SMALL.replaced(**{"motion.laws": ["parabolic", "constant-velocity"], "machine.guide_friction": 0.0})


def test_peaks_are_those_of_each_scene_and_a_refusal_is_a_reason():
    """Peak force of the parabolic law: W + 4 m s/T2."""
    changes = [Change("own"), Change("slow", {"motion.duration": 6.0}), Change("wet", {"mix.moisture": 0.5})]
    found = ensemble(LAWS, [*changes, Change("free", resistance=dry_resistance(0.0))])
    own, slow, free = (found[number]["peak_force"]["parabolic"] for number in (0, 1, 3))
    inertia = 4 * LAWS.machine.mass * LAWS.motion.stroke / LAWS.motion.duration**2
    assert free == pytest.approx(inertia)
    assert own - slow == pytest.approx(0.75 * inertia)
    assert np.isinf(found[0]["peak_force"]["constant-velocity"])
    assert first_law(found[0]["peak_force"]) == "parabolic"
    assert list(found[2]) == ["reason"]
    assert "mix.moisture: must be " in found[2]["reason"]


def test_held_resistance_scales_the_peak_here_and_in_a_worker():
    stages = build_stages(LAWS)
    cycles, cart = stages.laws.cycles, replace(stages.resistance.cart, mass=0.0)
    run = partial(drive_peaks, cart, cycles, dry_resistance(100.0), ("peak_force",))
    changes = [Change(f"{scale:g}", resistance=dry_resistance(100.0 * scale)) for scale in (1.0, 1.5)]
    here = ensemble(LAWS, changes, run)
    assert [here[number]["peak_force"]["parabolic"] for number in (0, 1)] == [100.0, 150.0]
    with ProcessExecutor(1) as executor:
        assert ensemble(LAWS, changes, run, executor) == here
