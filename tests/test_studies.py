"""Every study runs with small inputs, and one of its numbers is verified independently."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from compact.analysis.calibration import calibrate
from compact.engines.compaction.engine import roll
from compact.rolling_contact import Layer, Roller
from compact.scene.plant_data import read_measurements

MEASURED = "loveikin-2015-printed.toml"
STUDIES = Path(__file__).parent.parent / "studies"
TABLE = STUDIES.parent / "docs" / "which_law.md"


def study(name):
    specification = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.fixture
def ran(capsys, tmp_path):
    """Results of a study with small inputs that prints the words; its pictures are not empty."""

    def results(name, words, **options):
        module = study(name)
        found = module.main(out=tmp_path, **options)
        module.show(list(found.values()) if isinstance(found, dict) and name != "speed_against_plain" else found)
        assert words in capsys.readouterr().out
        assert all(picture.stat().st_size > 10_000 for picture in tmp_path.glob("*.png"))
        return found

    return results


def test_every_study_has_a_test():
    called = re.findall(r'(?:study|ran)\("(\w+)"', Path(__file__).read_text("utf-8"))
    assert {path.stem for path in STUDIES.glob("*.py")} == set(called)


def test_first_law_over_drive_and_turn_is_that_of_an_independent_integrator(ran):
    """Peaks by explicit steps of 22 us with sticking by the guides, 40 cycles, to 2 %."""
    laws = ["parabolic", "cubic", "complex", "cycloidal", "reversal-2", "combined-2", "reversal-3-free-acceleration"]
    module = study("turning_and_drive")
    turns = {name: module.TURNS[name] for name in ("rebuilt over 10 mm", "50 mm", "own track of 110 mm, then 26 mm")}
    springs = ((1e6, 0.05), (1e7, 0.05))
    rows = ran("turning_and_drive", "first by force", springs=springs, turns=turns, **{"motion.laws": laws})
    expected = [
        ("parabolic", 10187, "reversal-2", 4793), ("cycloidal", 8570, "cubic", 3590),
        ("parabolic", 6027, "cubic", 3206),
        ("reversal-3-free-acceleration", 6573, "reversal-3-free-acceleration", 2882),
        ("reversal-3-free-acceleration", 5310, "reversal-3-free-acceleration", 2410),
    ]  # fmt: skip
    for row, (law, force, frugal, power) in zip(rows, expected, strict=True):
        assert (row.law, row.frugal) == (law, frugal)
        assert (row.force, row.power) == (pytest.approx(force, rel=0.02), pytest.approx(power, rel=0.02))


@pytest.mark.slow
def test_engines_agree_with_finite_elements_by_hand_and_name_the_open_codes_that_are_not_installed(capsys):
    module = study("open_codes")
    rows, missing = module.compare()
    module.show(rows, missing, markdown=True)
    found = {row.code: row.difference for row in rows}
    assert found.keys() | set(missing) == {code for codes in module.CASES.values() for code in codes}
    assert found.keys() >= {"spectral", "fem", "scikit-fem by hand", "hertz", "return mapping"}
    assert all(abs(difference) < 5e-5 for difference in found.values())
    assert capsys.readouterr().out.count("\n") == 2 + len(rows) + (len(missing) > 0)


@pytest.mark.slow
def test_resistance_after_a_turn_is_a_share_of_the_steady_one(capsys):
    """On a layer of 20 mm, on 4 elements: the own track, the first front, and the constants refitted."""
    module = study("reversal")
    found = module.main(("thin layer",), (2.0,), increments=4)
    module.show(**found)
    assert "thin layer   2.00" in capsys.readouterr().out
    (each,) = found["histories"].values()
    middle = (each.force[1:] + each.force[:-1]) / 2  # of the steps between which the mesh alternates
    assert np.abs(middle[(each.x[1:] > -0.7) & (each.x[1:] < -0.1)]).max() < 0.05
    assert middle[-2:] == pytest.approx(1, abs=0.05)
    assert found["values"][module.CONSTANTS.index("CLIMB")] == pytest.approx(2.0, rel=0.3)


@pytest.mark.slow
def test_strength_of_loose_mix_decides_the_resistance(tmp_path):
    """Marching without jumps agrees with the steady search; mix with a shear line and 20 kPa has almost no bow wave."""
    module = study("strength_of_loose_mix")
    _, ellipse, _, line = module.main(increments=(4, 6), names=("ellipse", "line, c 20 kPa"), out=tmp_path)
    roller = Roller(module.RADIUS, indentation=module.DEPTH, friction=0.35, rolling="free", profile="deformed")
    layer = Layer(module.LIFT * module.EXIT / module.FED)
    for found, material, scatter in ((ellipse, module.ellipse(), 0.02), (line, module.line(cohesion=20e3), 0.04)):
        steady = roll(layer, roller, material, 0.133, increments=6)  # bands of the line pass under the roller
        assert found.steady
        assert found.load == pytest.approx(module.LENGTH * steady.load, rel=scatter)
        assert found.resistance == pytest.approx(module.LENGTH * steady.resistance, rel=0.02)
    assert line.resistance / ellipse.resistance == pytest.approx(0.56, abs=0.03)
    assert line.bow_wave < 0.1 * ellipse.bow_wave


@pytest.mark.slow
def test_errors_of_random_lifts_cover_the_change_to_finer_meshes(capsys):
    """A sliding, a driven and a free roller by 5 and by 10 elements per contact length."""
    module, number = study("random_lifts"), r"(\S+) \+- (\S+) %"
    coarse, fine = (
        [np.array(re.findall(number, line), float) for line in module.main(["0", "1", "2", "--increments", count])]
        for count in ("5", "10")
    )
    for (values, told), (better, remaining) in zip((each.T for each in coarse), (each.T for each in fine), strict=True):
        assert (np.abs(values / better - 1) < (told + remaining) / 100).all()
    assert capsys.readouterr().out.count("3 steady") == 2


@pytest.mark.slow
def test_ranking_with_air_of_columns_is_that_of_heckels_curve(capsys):
    """Drained columns: work of compression on the curve, with elastic strain, less that of the elastic release."""
    module = study("ranking_with_air")
    module.main(["--mixes", "cap, columns", "--airs", "drained", "one-way, 1e-13 m2"])
    drained, one_way = (line.split(" | ") for line in capsys.readouterr().out.splitlines()[2:4])
    bulk, oedometric, lateral = 100e6, 161.5e6, 1 - np.sin(np.radians(35))  # E 120 MPa, Poisson's ratio 0.3
    k = np.linspace(0.936, 0.99, 20001)
    pressure = np.log(0.28 / (1 - k)) / 1.487e-5
    elastic = pressure * (1 + 2 * lateral) / 3 / bulk
    height = 0.06 * 0.98 / 0.936 * np.exp(-np.log(k / 0.936) - elastic)
    loading = height > height[0] * np.exp(elastic[0]) - 0.003
    work = np.trapezoid(pressure[loading], -height[loading]) + pressure[0] * elastic[0] / 2 * height[0]
    release = pressure[loading][-1] ** 2 / (2 * oedometric) * height[loading][-1]
    found = [float(value) for value in drained[2].split(", ")]
    assert found == pytest.approx(3 * [work - release], rel=0.01)
    assert drained[3].startswith("parabolic")
    with_air = [float(value) for value in one_way[2].split(", ")]
    assert found[0] < with_air[0] < with_air[1] < with_air[2]


def test_duration_has_the_first_laws_of_every_model(ran):
    """Columns without air cross where the formula does, but for the rate of compaction."""
    laws = {"motion.laws": ["parabolic", "cubic", "combined-2", "reversal-4-free-acceleration"]}
    laws |= {"drive.turn": "step"}  # of the crossovers in closed form
    told, options = "| formula | peak drive force | parabolic, 3740 N", {"over": "duration=0.3:3:3", "changes": laws}
    answers = ran("duration", told, cases=("formula", "columns"), **options)
    formula, columns = (each.segments["peak_power"] for each in answers)
    assert [law for law, *_ in formula] == [law for law, *_ in columns] == laws["motion.laws"][1:]
    assert formula[0][2] == pytest.approx(0.847, abs=1e-3)
    assert columns[0][2] == pytest.approx(formula[0][2], rel=0.03)


def test_table_of_engines_in_the_readme_is_the_recorded_one():
    """`python studies/speed_against_error.py engines` records and prints it."""
    module = study("speed_against_error")
    table = module.engine_table(module.read_recorded())
    assert table in (STUDIES.parent / "README.md").read_text(encoding="utf-8")
    assert "| `column` |" in table


@pytest.mark.slow
def test_formulas_laws_and_layers_are_timed_against_plain_code(ran):
    few = {"points": 1000, "repeats": 1, "samples": (101, 1001), "speeds": 2, "tolerances": (1e-2,)}
    result = ran("speed_against_plain", "goal 10", targets=({"indentation": 0.003}, {"load": 15e3}), **few)
    assert list(result["formulas"]) == [f"1.{i}" for i in range(1, 11)]
    (_, coarse, _), (_, fine, _) = result["peaks"]
    assert fine < coarse / 20  # a smooth maximum: the error of sampling is proportional to the square of the step
    assert [target for target, *_ in result["consecutive"]] == ["indentation", "load"]
    ((_, _, fem_error, plain_error, *_),) = result["plain"]
    assert max(fem_error, plain_error) < 1e-2  # the plain solution uses no assembly, streamlines or contact of `fem`


@pytest.mark.slow
def test_errors_converge_with_the_settings_and_defaults_are_marked(capsys, tmp_path):
    module = study("speed_against_error")
    answers = module.main(
        layers=(("spectral", 1e-2), ("spectral", 1e-4), ("fem", 3e-3)),
        drives=(("compact", 1e-8), ("RK45", 1e-3), ("RK45", 1e-6)),
        maps=(("map", 1e-1),),
        columns=(("column", 1e-5), ("column", 1e-9)),
        repeats=1,
        out=tmp_path,
    )
    module.show(answers)
    assert all(error <= tolerance for _, tolerance, error, *_ in answers["layers"])
    own, rough, fine = (error for _, _, error, *_ in answers["drives"])
    assert own < fine < rough < 1e-2  # all compared with the closed form of the harmonic law
    ((_, _, error, _, contacts),) = answers["maps"]
    assert error < 0.1
    assert contacts >= 5
    assert answers["columns"][1][2] < 1e-8
    assert capsys.readouterr().out.count("default") == 3


@pytest.mark.slow
def test_compaction_finds_one_state_from_both_starts():
    """Waves relax within 24 contact lengths, so that the search leaves the distance that it tells."""
    module = study("compaction_baseline")
    found, low, high = module.reference(4)
    layer, roller, mix = module.published_lift()
    told = roll(layer, roller, mix, module.SPEED, increments=4).error_parts
    assert high == pytest.approx(low, rel=2e-3)
    assert (np.abs(found / np.mean([low, high], axis=0) - 1) < np.add(told.drift, told.start)).all()


@pytest.mark.slow
def test_pore_air_of_the_lift_depends_on_speed_over_permeability_and_raises_the_bow_wave(capsys):
    module = study("pore_air")
    case = module.rolled(increments=4)
    found = module.one_way(case, None)
    assert found[0, -1] == pytest.approx(np.array([0.0817, 0.0795]), rel=0.03)  # 1e-12 m2 at 2.1 m/s
    same = module.one_way(case, None, permeabilities=(1e-13,), speeds=(0.21,))
    assert same[0, 0] == pytest.approx(found[0, -1], rel=1e-6)
    module.show_one_way("columns", module.columns(), (0.90,))
    assert "a tenth of the load at" in capsys.readouterr().out
    rows = list(module.coupled(case, (7e10, 5e11)))
    for _, alone, changes, wave, _ in rows:
        assert changes[1] > 3 * alone[1]
        assert wave > case[3].bow_wave
    # at the permeability of the prior the wave grows without slowing
    *_, before, last = module.growth(case, 0.13, "drained")
    assert last[4] > 0.9 * before[4] > 8e-4
    assert last[5] > 5e-4


def test_formula_ranking_scales_the_resistance_with_the_mix():
    rows = study("formula_ranking").main()
    assert [end for end, _, _ in rows] == ["low", "value", "high"]
    low, value, high = (force for _, force, _ in rows)
    assert value == pytest.approx(2 * 9740 * 0.178961, rel=1e-5)
    assert (
        low < value / 2.25 * 1.01
    )  # the force is proportional to the square of the pressure; the coefficient decreases a little
    assert high > value * 2.25 * 0.99


def test_formulas_against_a_deep_layer_agree_with_hertz():
    module = study("formula_against_fem")
    mixture = {"moistures": (0.08,), "density_ratios": (0.98,), "radii": (0.09,)}
    rows = {row[3]: row for row in module.main(**mixture)}
    assert list(rows) == ["1.5-1.8", "galin", "spectral", "fem"]
    # at one peak pressure and no friction 1.6 over Hertz is 1.0026 (sin phi 0.94125)^2 for every mix
    assert rows["1.5-1.8"][6] / rows["galin"][6] == pytest.approx(1.00255 * 0.94125**2, rel=1e-5)
    assert rows["1.5-1.8"][7] == pytest.approx(0.118246 + 0.05, rel=1e-9)  # f2 + f3 alone
    assert rows["fem"][4:7] == pytest.approx(rows["spectral"][4:7], rel=3e-3)
    assert rows["fem"][7] == pytest.approx(rows["spectral"][7], rel=5e-3)


@pytest.mark.slow
def test_operating_point_needs_compaction(ran):
    module, told = study("operating_point"), "K_H 14.4 1/MPa of the prior requires a roller of 1.09 m"
    before, after, fits = ran("operating_point", told, engines=("column",))
    (_, _, _, load, coefficient, cart, *_), (_, slope, fed, *_) = before
    assert (load, coefficient, cart) == pytest.approx((9740, 0.178961, 3562), rel=1e-4)  # eq 1.8 is fitted to it
    assert (slope, fed) == pytest.approx((14.379e-6, 0.94), rel=1e-4)
    ((_, slope, fed, load, coefficient, cart, *_),) = after
    assert (load, coefficient) == pytest.approx((9740, 0.179), rel=1e-6)
    assert cart == pytest.approx(2 * 9740 * 0.179 + 0.008 * 9480, rel=1e-6)
    assert (slope, fed) == pytest.approx((15.228e-6, 0.93430), rel=1e-4)
    length = module.length_for(fits["column"], module.PRIOR_SLOPE.value)
    shorter = calibrate(
        fits["column"].scene.replaced(**{"machine.roller_length": length}), read_measurements(module.SCENES / MEASURED)
    )
    assert shorter.heckel_slope == pytest.approx(14.379e-6, rel=0.02)  # log-linear interpolation between two lengths


def test_lifts_share_the_resistance_of_one_pass(ran):
    options = {"radii": (0.11,), "moistures": (0.10, 0.11), "counts": (1, 3)}
    rows = ran("density_after_passes", "passes", **options)
    (*_, one, dense), (*_, three, denser), *wetter = rows
    # the resistance of a lift depends on its reduction, and on its rate: sqrt 3 times that of the whole product
    faster = (1 + 0.02 * np.log(1 + 3**0.5 * 125)) / (1 + 0.02 * np.log(1 + 125))
    assert three == pytest.approx(faster * one / 3, rel=1e-3)
    assert (dense, denser) == pytest.approx((0.98, 0.98), abs=1e-6)
    assert wetter[0][4] < one  # wetter mix requires less pressure


@pytest.mark.slow
def test_elastic_drive_has_an_impact_at_the_reversal_for_any_stiffness(ran):
    options = {"laws": ("parabolic", "septic"), "stiffnesses": (1e7, 1e9), "ratio": 0.01, "turns": ("step", "build-up")}
    rows = ran("elastic_drive", "parabolic", **options)
    force, inertia = 3562.0, 1000 * 4 * 0.4 / 9
    impact = force + inertia + (4 * force * inertia - inertia**2) ** 0.5  # undamped, in closed form
    for row in rows[:2]:
        assert row[2] == pytest.approx(impact, rel=0.02)
    assert rows[3][3] < rows[2][3] < 1.3  # the septic law starts with vanishing acceleration
    assert [row[3] for row in rows[5::2]] == pytest.approx([1, 1], abs=2e-3)  # a mix lets go before the cart has speed
    assert all(row[7] < 1e-6 for row in rows)


@pytest.mark.slow
def test_formula_and_finite_elements_differ_in_the_resistance_only(ran, tmp_path):
    module, options = study("moisture_density"), {"moistures": "0.08,0.10", "ratios": "0.94,0.98"}
    table = ran("moisture_density", "points without numbers", **options)
    assert (table["reason"] == "").all()
    found = module.ratios_to(table, "fem")
    assert np.abs(found["formula", "load"] - 1).max() < 0.08
    assert found["formula", "resistance"].min() > 3
    # f2 + f3 for every mix; half-plane theory has the load of a deep layer
    assert table.sel(engine="formula").resistance_coefficient.values == pytest.approx(0.168246)
    assert table.sel(engine="column").exit_density_ratio.values == pytest.approx(
        np.broadcast_to([0.94, 0.98], (2, 2)), abs=1e-6
    )
    assert module.main(**options, out=tmp_path).identical(table)


LIMITS = {  # largest relative error to another method, a limit or a balance
    "Poisson's ratio 0.5 - 1e-9, spectral": 1e-3,
    "contact 0.02 layer heights wide": 1e-3,
    "speed 1e-9 m/s": 1e-9,
    "speed 1e9 m/s": 1e-7,
    "friction 1, sliding, high layer": 1e-7,
    "lower ply a thousand times as stiff": 1e-3,
    "columns compacted to a density ratio of 0.995": 1e-9,
    "columns, second pass at the same height": 1e-9,
    "speed through 0, stick and slip": 1e-8,
    "complex law at a double root": 1e-8,
    "dwell of length zero": 1e-12,
    "run-up of a millionth of the pass": 1e-5,
    "cam too narrow for its follower": 0.0,
    "non-finite speed, load, indentation": 0.0,
}
SLOW_LIMITS = {
    "Poisson's ratio 0.49, bonded": 1e-3,
    "frictionless base": 1e-3,
    "contact 5 layer heights wide, finite elements": 1e-3,
    "indentation 1e-9 m": 1e-3,
    "spring of 1e9 N/m, dry friction, parabolic law": 0.02,
}
REFUSED = ("discontinuous resistance over speed", "load that exceeds the capacity of the layer")


def test_hard_cases_are_solved_or_refused(ran, tmp_path):
    names = [*LIMITS, *REFUSED]
    assert set(study("hard_cases").CASES) == {*names, *SLOW_LIMITS}
    rows = {row[0]: row for row in ran("hard_cases", "reference", names=names)}
    assert [name for name, most in LIMITS.items() if not rows[name][3] <= most] == []
    assert all(rows[name][2].startswith("refused: ") for name in REFUSED)
    assert (tmp_path / "hard_cases.csv").read_text().count("\n") == 1 + len(rows)


@pytest.mark.slow
def test_hard_cases_of_finite_elements_and_stiff_drives_are_solved():
    rows = study("hard_cases").main([*SLOW_LIMITS])
    assert [row[0] for row in rows if not row[3] <= SLOW_LIMITS[row[0]]] == []


def test_fluctuation_is_inverse_to_the_inertia(ran):
    options = {"laws": ("cubic",), "carts": (1, 4), "inertias": (50.0, 500.0), "drive.turn": "step"}
    rows = ran("motor_and_flywheel", "cubic", **options)
    for row in rows:
        assert row[3] * row[6] == pytest.approx(row[1] * 0.8 * 3562, rel=1e-5)  # work of a turn: that of friction
        assert row[9] < 1e-6
    for light, heavy in (rows[:2], rows[2:]):
        assert light[4] / heavy[4] == pytest.approx(10, rel=0.02)  # amplitude of the work over J w^2
    assert rows[3][4] < rows[1][4]


@pytest.mark.slow
def test_optimal_laws_reduce_power_at_both_ends_of_the_spread(ran):
    options = {"shares": (0.0, 2 / 3), "jerks": (5.0, 50.0)}
    gains, front = ran("optimal_laws", "of least regret", **options)
    assert [row[0] for row in gains] == ["peak_force"] * 3 + ["peak_power"] * 3
    force = gains[0]
    assert force[3] == pytest.approx(3562 + 1000 * 7.2 * 0.4 / 9, rel=1e-5)  # reversal-2 has constant acceleration
    # 0.3 m/s2 up to 0.15 m/s, again from the steady part on for 1/6 s, then -0.6 m/s2: 0.4 m in 3 s
    assert force[4] == pytest.approx(3562 + 1000 * 0.3, rel=1e-5)
    assert all(row[7] > 0.02 for row in gains[3:])  # the law of least regret, at every end
    assert all(row[5] < 1e-6 for row in front)
    ((_, _, free, *_), (_, _, steady, *_), (_, _, smooth, *_), (_, _, rough, *_)) = front
    assert free <= steady * (1 + 1e-6)
    assert rough < smooth


def test_constant_resistance_ranks_peak_forces_by_acceleration(capsys, monkeypatch, tmp_path):
    """The columns are fitted to the published point without a rate of compaction, so that both resist with 3562 N."""
    module = study("rank_laws")
    fitted = {"mix.overrides.heckel_slope": 13.881e-6, "layer.fed_density_ratio": 0.93432}
    monkeypatch.setitem(module.ENGINES, "column", fitted)
    laws = ["cubic", "parabolic", "reversal-2"]
    options = {"engines": ("formula", "column"), "drives": ("rigid",), "samples": 2}
    changes = {"motion.laws": laws, "mix.overrides.rate_sensitivity": 0.0}
    rows, spreads = module.main(**options, **changes, out=tmp_path)
    module.show((rows, spreads))
    places = {(row[0], row[4]): row for row in rows if row[2] == "peak_force"}
    # 1000 kg times 4, 6 and 7.2 strokes over 9 s2; the friction is what either engine resists with
    by_formula = [3562 + 1000 * c * 0.4 / 9 for c in (4, 6, 7.2)]
    for engine in ("formula", "column"):
        found = [places[engine, law][5] for law in ("parabolic", "cubic", "reversal-2")]
        assert found == pytest.approx(by_formula, rel=3e-4)
        assert [places[engine, law][3] for law in ("parabolic", "cubic", "reversal-2")] == [1, 2, 3]
    assert all(row[10] for row in places.values())  # margins of 2 %, errors of the maps of 1e-8
    for engine, _, by, _, stays, tau, least, largest, mixes in spreads:
        assert largest > 1.1 * least
        # m a + F has the order of a for every constant F; the samples of columns vary the rate sensitivity
        if (engine, by) == ("formula", "peak_force"):
            assert (stays, tau, mixes) == (1.0, pytest.approx(1.0), 2)
    assert "stays first in 100% of 2 mixes" in capsys.readouterr().out
    assert len((tmp_path / "rank_laws.csv").read_text().splitlines()) == 1 + len(rows)


@pytest.mark.slow
def test_compacted_mix_has_little_resistance_on_the_return_stroke(ran, tmp_path):
    module = study("return_stroke")
    done = ran("return_stroke", "return stroke", stroke=0.08, increments=4)
    forward = done.resistance[done.stroke == 1]
    *back, end = done.resistance[done.stroke == 2]
    assert -min(back[len(back) // 4 :]) < 0.25 * forward.max()  # the travel is too short for steady rolling
    assert done.position[-1] == pytest.approx(0, abs=1e-9)
    assert min(back) > end > -0.5 * forward.max()  # at the edge of the initial indentation
    assert 0 < module.release_length(done) < 2e-3
    assert (tmp_path / "fields.pvd").is_file()


def test_documented_table_of_best_laws_is_that_of_the_study():
    module = study("rank_laws")
    (line,) = module.markdown(module.main(samples=2, engines=("formula",), drives=("rigid",))[0])[2:]
    assert line in TABLE.read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["formula", "column", "fem", "compaction"])
def test_every_row_of_the_table_of_best_laws_is_that_of_the_study(engine):
    module = study("rank_laws")
    lines = module.markdown(module.main(samples=2, engines=(engine,))[0])[2:]
    text = TABLE.read_text(encoding="utf-8")
    assert len(lines) == 3
    assert [line for line in lines if line not in text] == []


def test_resistance_over_speed_of_the_machine_meets_the_formula_at_the_mean_speed(ran, tmp_path):
    module = study("speed_dependence")
    cases, speeds = [case for case in module.CASES if "finite" not in case], np.geomspace(0.0133, 1.333, 5)
    found = ran("speed_dependence", "viscoelastic part only", cases=cases, speeds=speeds)
    curves = {each.name: each for each in found}
    printed, columns, linear = (curves[case].forces for case in cases)
    assert printed == pytest.approx(2 * 9740 * 0.178961, rel=1e-4)
    assert columns[2] == pytest.approx(printed[2], rel=2e-3)  # both at 9740 N and 0.179
    assert np.diff(np.log(columns)) / np.log10(speeds[1] / speeds[0]) == pytest.approx(0.039, abs=2e-3)
    assert linear.max() < 0.2 * printed[0]
    assert (tmp_path / "speed_dependence.png").exists()


@pytest.mark.slow
def test_pore_air_adds_to_the_finite_elements_over_speed():
    module = study("speed_dependence")
    options = {"speeds": np.array([0.02, 0.45]), "changes": {"accuracy.tolerance": 0.02}}
    with_rate, still, with_air = module.main(cases=["finite elements with rate"], **options)
    assert still.forces == pytest.approx(3505, rel=2e-2)
    assert np.log(with_rate.forces[1] / with_rate.forces[0]) / np.log10(22.5) == pytest.approx(0.043, abs=8e-3)
    assert (with_rate.forces < with_air.low).all()
    assert (with_air.low < with_air.forces).all()
    assert (with_air.forces < with_air.high).all()
    # by mix with almost no voids: 14 elements in one part have 1.15 to 1.21
    assert with_air.high[1] / with_rate.forces[1] == pytest.approx(1.26, abs=0.05)


@pytest.mark.slow
def test_robust_law_gains_most_where_force_and_distance_are_known(ran, monkeypatch):
    monkeypatch.setattr("compact.analysis.robust.law.FRESH_DRIVES", 50)
    module = study("robust_law")
    effort = module.Effort((4, 2), 9, 0, ("quintic",))
    cases = [module.EXACT[1], module.within("F within 30 %", 0.3, 0.0)]
    rows = ran("robust_law", "MN/m, F", cases=cases, effort=effort)
    assert [row[0] for row in rows] == ["closed, D 110 mm", "F within 30 %"]
    known, unknown = (row[4] for row in rows)
    assert known < unknown
    assert known < 0.9
    assert all(row[6] < 1e-6 for row in rows)
