"""Balances of work and mix: closed forms, columns as an independent integration, and the published throughput."""

import numpy as np
import pytest

from compact.analysis.material_tests import LaboratoryProgramme
from compact.analysis.sizing.balances import heckel_work
from compact.analysis.study import Study
from compact.material.laws import Compaction
from compact.report.text import say
from compact.scene.loader import load_scene

PRINTED = {"motion.duration": 0.4 / 0.45, "product.mould_speed": 1.1 / 60}  # .45 m/s, 1 to 1.15 m/min


def study(**changes):
    return Study(load_scene("small", **{"output.items": [], "drive.turn": "step"} | changes))


def test_confined_work_is_the_integral_in_closed_form():
    """int ln(c/(1-k))/k2 dk = [-ln(c/(1-k))/k] + int dk/(k (1-k)) by parts, with c = 1 - k0."""
    a, b, c, slope = 0.936, 0.98, 0.28, 14.4e-6

    def primitive(k):
        return -np.log(c / (1 - k)) / k + np.log(k / (1 - k))

    assert heckel_work(a, b, slope) == pytest.approx(b * (primitive(b) - primitive(a)) / slope, rel=1e-9)


def test_confined_work_is_that_of_the_oedometer_of_stiff_mix():
    material = Compaction(
        unloading_modulus=1e11, poisson=0.3, heckel_slope=14.4e-6, loose_density_ratio=0.72, critical_slope=1.0,
        tensile_strength=14e3, fed_density_ratio=0.936, heckel_test="confined",
    )  # fmt: skip
    test = LaboratoryProgramme(material, 0.98, 183e3).test("oedometer")
    end = int(test.axial_stress.argmax()) + 1
    # of the volume before: dw = s_v d(e_v) V, V = exp(-e_v); over the volume at the end
    work = np.trapezoid(test.axial_stress[:end] * np.exp(-test.axial_strain[:end]), test.axial_strain[:end])
    behind = test.density_ratio[end - 1]
    assert heckel_work(0.936, behind, 14.4e-6) == pytest.approx(work * behind / 0.936, rel=0.01)


def test_pass_of_columns_takes_the_work_of_confined_compression():
    """Columns without a rate: the work of the resistance is that of compression, less the elastic recovery."""
    balance = study(**{"accuracy.engine": "column", "mix.overrides.rate_sensitivity": 0.0}).work_balance
    assert balance.work_ratio == pytest.approx(1.0, abs=0.02)


def test_rate_raises_the_work_of_a_pass_by_its_factor():
    columns = {"accuracy.engine": "column", "mix.overrides.heckel_slope": 15.228e-6}
    still, rated = (study(**columns | {"mix.overrides.rate_sensitivity": m}).work_balance for m in (0.0, 0.02))
    assert rated.pass_work / still.pass_work == pytest.approx(1.1, abs=0.015)


def test_published_throughput_takes_fifty_times_the_work_of_a_pass():
    """3486 N by 0.4 m a stroke are 320 to 370 kJ/m3 of the 15 to 17 mm that the mould advances."""
    balance = study(**PRINTED).work_balance
    assert 1e3 * balance.carried_volume == pytest.approx(4.17, abs=0.01)
    assert balance.throughput_work == pytest.approx(3486 * 0.4 / balance.carried_volume, rel=0.001)
    assert 320e3 < balance.throughput_work < 370e3
    assert balance.strokes_on_section == pytest.approx(71.4, abs=0.1)
    assert balance.feed_ratio == pytest.approx(balance.strokes_on_section * 2 * 0.4 / 1.164)
    assert balance.explained_share == pytest.approx(0.05, abs=0.003)
    assert balance.fits is False


def test_speed_of_the_mould_at_which_mix_and_throughput_fit():
    """L/v strokes of T each over the strips n s/B of the product: at v = n s L/(B T) they press it once."""
    speed = 2 * 0.4 * 1.164 / (1.164 * 60.0)
    fits = study(**{"product.mould_speed": speed, "motion.duration": 60.0})
    fitting = fits.work_balance
    assert fitting.feed_ratio == pytest.approx(1.0, rel=1e-12)
    assert fitting.fits
    assert say("feed", fits) == "feed: the rollers press what the mould carries away"
    fast = study(**{"product.mould_speed": 3 * speed, "motion.duration": 60.0})
    assert fast.work_balance.feed_ratio == pytest.approx(1 / 3, rel=1e-12)
    assert "the rest remains uncompacted" in say("feed", fast)


def test_return_over_compacted_mix_presses_half_the_mix():
    columns = PRINTED | {"accuracy.engine": "column"}
    fresh, compacted = (
        study(**columns | {"layer.return_stroke": each}).work_balance for each in ("fresh", "compacted")
    )
    assert compacted.feed_ratio == pytest.approx(fresh.feed_ratio / 2)
    assert compacted.cycle_work < 0.6 * fresh.cycle_work
