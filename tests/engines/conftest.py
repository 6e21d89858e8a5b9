"""Fixture of the tests of lumped lifts."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from lift_sequences import sequence

from compact.engines.process import lifts as lumped_lifts


@pytest.fixture
def fake_roll(monkeypatch):
    """Passes that press a section to the lowest generatrix, uniformly and without elastic strain."""
    bites = []

    def press(layer, roller, material, speed, *, fed_layer, increments, steady_tolerance):
        bites.append(roller.indentation)
        share = 1 - roller.indentation / fed_layer.height
        points = replace(fed_layer.points, density_ratio=fed_layer.points.density_ratio / share)
        pressed = replace(fed_layer, heights=fed_layer.heights * share, points=points)
        return SimpleNamespace(exit=pressed, indentation=roller.indentation, bow_wave=0.0, work_residual=0.0)

    def record(passed, before, thickness, *_):
        found = sequence(to=0.8).lifts[0]
        return replace(found, thickness=thickness, density_ratio=passed.exit.density_ratio)

    monkeypatch.setattr(lumped_lifts, "roll", press)
    monkeypatch.setattr(lumped_lifts, "gyrations_of", lambda *_: 1.0)
    monkeypatch.setattr(lumped_lifts, "_lift", record)
    return bites
