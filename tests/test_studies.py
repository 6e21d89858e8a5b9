"""Every study runs small, and one number of it is known otherwise."""

import importlib.util
from pathlib import Path

import pytest

STUDIES = Path(__file__).parent.parent / "studies"


def study(name):
    specification = importlib.util.spec_from_file_location(name, STUDIES / f"{name}.py")
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def test_every_study_has_a_test():
    tested = {"speed_against_error", "formula_ranking"}
    assert {path.stem for path in STUDIES.glob("*.py")} == tested


def test_speed_against_error_measures_every_formula_and_sampling_converges(capsys, tmp_path):
    module = study("speed_against_error")
    result = module.main(points=1000, repeats=1, samples=(101, 1001), out=tmp_path)
    module.show(result)
    assert list(result["formulas"]) == [f"1.{i}" for i in range(1, 11)]
    (_, coarse, _), (_, fine, _) = result["peaks"]
    assert fine < coarse / 20  # a smooth top: the error of sampling falls with the square of the step
    assert "goal 10" in capsys.readouterr().out
    assert (tmp_path / "speed.csv").read_text().count("\n") == 1 + 10 + 4 + 3


def test_formula_ranking_scales_the_resistance_with_the_mix():
    rows = study("formula_ranking").main()
    assert [end for end, _, _ in rows] == ["low", "value", "high"]
    low, value, high = (force for _, force, _ in rows)
    assert value == pytest.approx(2 * 9740 * 0.178961, rel=1e-5)
    assert low < value / 2.25 * 1.01  # force follows the square of the pressure, the coefficient falls a little
    assert high > value * 2.25 * 0.99
