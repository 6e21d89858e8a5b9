"""Laws over the duration of a pass: closed forms of crossovers, agreement with scenes of that duration, refusals."""

import numpy as np
import pytest

from compact.analysis.sizing.durations import read_durations
from compact.analysis.study import Study
from compact.scene.loader import load_scene

STEP = {"drive.turn": "step"}  # of the closed forms and the published durations
COLUMN = {"accuracy.engine": "column", "contact.speeds": [0.05, 0.2]}


def study(over="duration=0.3:3:4", scene="small", **changes):
    given = load_scene(scene, **{"output.items": []} | STEP | changes)
    return Study(given, durations=read_durations(over))


@pytest.fixture(scope="module")
def published():
    """Laws that are first or second somewhere; the margins are those among all laws."""
    laws = [
        "parabolic", "modified-trapezoid", "harmonic", "cubic", "crank", "combined-2", "combined-3",
        "reversal-3-free-acceleration", "reversal-4-free-acceleration", "reversal-4-free-both",
    ]  # fmt: skip
    return study("duration=0.3:3:4", **{"motion.laws": laws}).over_durations


def test_crossover_of_two_laws_is_that_of_the_closed_form():
    """Rollers without guides: peak force of the parabolic law W + 4 m s/T2; of reversal-2 at most W + 4.5 m s/T2.

    Peak power of the parabolic law (W + 4 m s/T2) 2 s/T; the cubic law has the largest of (W + m a) v over its pass.
    """
    changes = {"motion.laws": ["parabolic", "cubic"], "machine.guide_friction": 0.0}
    found = study(**changes)
    force = found.stages.resistance.resistance(np.array([1.0]), np.zeros(1))[0]
    mass, stroke = 1000.0, 0.4

    def cubic(duration):
        z = np.linspace(0, 1, 200_001)
        velocity, acceleration = 6 * z * (1 - z) * stroke / duration, (6 - 12 * z) * stroke / duration**2
        return np.max(np.abs((force + mass * acceleration) * velocity))

    def parabolic(duration):
        return (force + 4 * mass * stroke / duration**2) * 2 * stroke / duration

    for crossover in found.over_durations.crossovers:
        if crossover.by == "peak_power":
            assert cubic(crossover.duration) == pytest.approx(parabolic(crossover.duration), rel=1e-6)
    for duration, order in zip(found.durations, found.over_durations.orders["peak_power"], strict=True):
        values = {each.run.name: each.value for each in order}
        assert values["parabolic"] == pytest.approx(parabolic(duration), rel=1e-9)
        assert values["cubic"] == pytest.approx(cubic(duration), rel=1e-6)


def test_published_machine_has_the_laws_of_its_three_durations(published):
    """3 s: parabolic and reversal-4-free-acceleration; .889 s: parabolic and combined-2; .3 s: parabolic and cubic."""
    found = published
    assert [law for law, *_ in found.segments("peak_force")] == ["parabolic"]
    power = found.segments("peak_power")
    assert [law for law, *_ in power] == ["cubic", "combined-2", "reversal-4-free-acceleration"]
    assert power[0][2] == pytest.approx(0.847, abs=0.001)
    assert power[1][2] == pytest.approx(1.677, abs=0.001)
    first, last = found.orders["peak_power"][0][0], found.orders["peak_power"][-1][0]
    assert (first.value, last.value) == (pytest.approx(25451, rel=1e-3), pytest.approx(532.5, rel=1e-3))
    margins = [order[0].margin for order in found.orders["peak_force"]]
    assert (margins[0], margins[-1]) == (pytest.approx(0.185, abs=1e-3), pytest.approx(0.011, abs=1e-3))


@pytest.mark.parametrize("engine", [{}, pytest.param(COLUMN, marks=pytest.mark.slow)], ids=["formula", "column"])
def test_each_duration_is_a_scene_of_that_duration_at_the_same_height(engine):
    """Formula: exactly. Columns: at the indentation of the scene, with a map of its own, within the tolerance."""
    found = study("duration=1:3:2", **engine)
    depth = {} if not engine else {"contact.indentation": found.stages.contacts.held.value}
    for duration, order in zip(found.durations, found.over_durations.orders["peak_force"], strict=True):
        alone = Study(load_scene("small", **STEP | engine | depth | {"motion.duration": duration}))
        for each in order:
            rel = 1e-12 if not engine else 5e-3
            assert alone.stages.drive.runs[each.run.name].peak_force == pytest.approx(each.value, rel=rel)


def test_law_that_is_first_between_two_durations_is_found(published):
    """Two durations, cubic and reversal-4-free-acceleration at the ends, combined-2 between them."""
    given = ["cubic", "combined-2", "reversal-4-free-acceleration"]
    found = study("duration=0.3:3:2", **{"motion.laws": given}).over_durations
    assert [law for law, *_ in found.segments("peak_power")] == given
    crossovers = [each for each in found.crossovers if each.by == "peak_power"]
    for coarse, dense in zip(crossovers, published.crossovers, strict=True):
        assert coarse.duration == pytest.approx(dense.duration, rel=1e-5)
