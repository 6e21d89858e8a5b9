"""Operating window of a forming process: limits that are met, and calibration by the rows of a plant."""

import pytest

from compact.analysis.operating_window import calibrate_window, limits_met, reached_by, window_digest
from compact.analysis.process import ProcessStudy
from compact.report.text import sentences
from compact.scene.loader import load_scene
from compact.scene.plant_data import StrokeRow

SHORT = {"machine.roller_length": 0.3, "process.layers": 1, "process.product_density_ratio": None}
OFFERED = {"process.offered_thickness": 4e-3}
PLANT = {  # other mix, sleeves, plate and feed than those of the scene
    "mix.overrides.heckel_slope": 1e-5, "mix.overrides.unloading_modulus": 180e6, "process.extrusion_pressure": 180e3,
    "process.offered_thickness": 4.5e-3, "process.feed_density_ratio": 0.77, "process.plate_pressure": 30e3,
    "sleeve.head": 0.6, "sleeve.wall_friction": 0.25,
}  # fmt: skip
MOTOR = {
    "curve": "linear", "torque": 10.0, "speed": 100.0, "gear_ratio": 40.0, "inertia": 0.01, "flywheel_inertia": 5.0,
}  # fmt: skip
ROWS = (0.0175, 67.5), (0.013, 67.5), (0.0175, 50.0), (0.03, 90.0), (0.022, 60.0)
HELD_OUT = (0.015, 60.0), (0.02, 80.0), (0.025, 90.0), (0.0118, 60.0), (0.033, 90.0)  # the last faster than all rows
BEYOND = (0.027, 60.0), (0.0105, 45.0)  # 27 mm a stroke, where the sleeves of the plant limit; fewer strokes a minute


def plants_row(scene, place):
    return StrokeRow(*place, *reached_by(ProcessStudy(scene.replaced(**StrokeRow(*place).changes(0.0)))))


@pytest.mark.slow
def test_five_rows_of_a_plant_calibrate_the_window():
    """Rows of another parameter set; at other points the density is within 0.01 and the force within 15 %."""
    scene = load_scene("process", **SHORT, **OFFERED)
    plant = scene.replaced(**PLANT)
    found = calibrate_window(scene, [plants_row(plant, place) for place in ROWS])
    for place in HELD_OUT:
        row = plants_row(plant, place)
        before = reached_by(ProcessStudy(scene.replaced(**row.changes(0.0))))
        density, force = reached_by(ProcessStudy(found.scene.replaced(**row.changes(0.0))))
        assert density == pytest.approx(row.density_ratio, abs=0.01)
        assert force == pytest.approx(row.force, rel=0.15)
        assert abs(before[0] - row.density_ratio) > 0.01
        assert limits_met(ProcessStudy(found.scene.replaced(**row.changes(0.0)))) == ""
    digest = window_digest(found)
    assert "extrusion_pressure" in digest
    assert "measured_strokes = [50.0, 90.0]  # of the rows" in digest
    for place, words in zip(
        BEYOND, ("stroke 0.027 m in place of 0.0116 to 0.022 m", "minute 45 in place of 50 to 90"), strict=True
    ):
        study = ProcessStudy(found.scene.replaced(**StrokeRow(*place).changes(0.0)))
        assert "rows" in limits_met(study)
        assert any(words in remark for remark in sentences("process_remarks", study))
    fast = plants_row(plant, BEYOND[0])  # told, and wrong: no row meets the limit of the sleeves
    error = reached_by(ProcessStudy(found.scene.replaced(**fast.changes(0.0))))[0] - fast.density_ratio
    assert abs(error) > 0.02


@pytest.mark.parametrize(
    ("changes", "met"),
    [
        ({"process.extrusion_pressure": 340e3, "machine.roller_length": 0.1, "process.mould_speed": 0.03}, "bite"),
        ({"process.offered_thickness": 1e-3, "process.extrusion_pressure": 340e3}, "feed"),
        ({"process.extrusion_pressure": 3e5}, "full density"),
        ({}, ""),
        ({"drive.kind": "motor", "drive.motor": MOTOR}, "drive"),
    ],
)  # fmt: skip
def test_limits_are_named(changes, met):
    assert limits_met(ProcessStudy(load_scene("process", **SHORT | changes))) == met
