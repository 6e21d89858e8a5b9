"""Strokes between reversals, and the positions at which time steps end."""

import numpy as np
import pytest

from compact.engines.stroke_schedule import TURN_STEP_ENDS, stroke_schedule
from compact.motion.profile import LAWS, law


@pytest.mark.parametrize("name", [name for name in LAWS if name != "crank"])
def test_every_cycle_has_a_forward_and_a_return_stroke(name):
    motion = law(name, 0.4, 3.0)
    assert stroke_schedule(motion).places == pytest.approx([0.0, 0.4], abs=1e-12)
    assert stroke_schedule(motion.cycle()).places == pytest.approx([0.0, 0.4, 0.0], abs=1e-12)
    assert stroke_schedule(motion.cycle()).times == pytest.approx([0.0, 3.0, 6.0], abs=1e-3)


def test_reversal_between_discontinuities_is_found():
    class Swing:
        duration = 2.0

        def position(self, time):
            return np.sin(3 * np.asarray(time))

    way = stroke_schedule(Swing())
    assert way.places == pytest.approx([0.0, 1.0, -1.0, np.sin(6.0)], abs=1e-12)
    assert way.times[1:-1] == pytest.approx([np.pi / 6, np.pi / 2], abs=1e-6)
    assert (way.low, way.span) == pytest.approx((-1.0, 2.0))


def test_steps_end_at_fractions_of_elements():
    motion = law("quintic", 0.1, 1.0)
    times, places = stroke_schedule(motion).steps(0, 0.01)
    assert places[:7] == pytest.approx(0.01 * np.append(0.0, TURN_STEP_ENDS))
    assert np.diff(places[6:]) == pytest.approx(0.0025)
    assert places[-1] == pytest.approx(0.1)
    assert motion.position(times) == pytest.approx(places, abs=1e-9)


def test_stroke_starts_at_the_end_of_a_dwell():
    way = stroke_schedule(law("quintic", 0.1, 1.0).cycle(far_dwell=0.5))
    times, _ = way.steps(1, 0.01)
    assert times[0] == pytest.approx(1.5, abs=2e-3)
    assert way.steps(0, 0.01)[0][-1] == pytest.approx(1.0, abs=1e-3)
