"""Laboratory tests of a mix in a directory: material.csv, material.json, material.png, and their digest."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest
from compact.files import write_csv, write_figure, write_json
from compact.report.figures.material import draw_material_tests

HEADER = (
    "test", "specimen", "lateral_pressure_Pa", "axial_strain", "volume_strain", "axial_stress_Pa", "lateral_stress_Pa",
    "transverse_stress_Pa", "mean_pressure_Pa", "von_mises_stress_Pa", "density_ratio",
)  # fmt: skip


def write_material_tests(programme: LaboratoryProgramme, law: str, directory: Path) -> list[Path]:
    """Write the paths of all tests, their results and the figure.

    Parameters
    ----------
    law : str
        Yield surface of the mix, as in the scene.
    directory : Path
        Existing directory.

    Returns
    -------
    list of Path
        Files written.
    """
    table = write_csv(directory / "material.csv", HEADER, path_rows(programme.tests))
    summary = directory / "material.json"
    write_json(summary, material_summary(programme, law))
    return [table, summary, write_figure(directory / "material.png", draw_material_tests(programme))]


def material_summary(programme: LaboratoryProgramme, law: str) -> dict[str, Any]:
    """Return the results of all tests for material.json, in SI units and degrees."""
    slope = programme.heckel_slope()
    result: dict[str, Any] = {
        "law": law,
        "heckel_slope": {"value": slope, "unit": "1/Pa"},
        "earth_pressure_coefficient": {"value": programme.earth_pressure_coefficient, "unit": "1"},
        "pressure": {"value": programme.pressure, "unit": "Pa"},
        "specimens": {},
    }
    for specimen, ratio in (("loose", programme.material.fed_density_ratio), ("compacted", programme.density_ratio)):
        angle, cohesion = programme.mohr_coulomb(specimen)
        result["specimens"][specimen] = {
            "density_ratio": {"value": float(ratio), "unit": "1"},
            "unconfined_strength": {"value": programme.test("unconfined", specimen).strength, "unit": "Pa"},
            "shear_strength": {"value": programme.test("pure shear", specimen).strength / 2, "unit": "Pa"},
            "friction_angle": {"value": angle, "unit": "deg"},
            "cohesion": {"value": cohesion, "unit": "Pa"},
        }
    return result


def material_digest(programme: LaboratoryProgramme, law: str) -> str:
    """Return the results of all tests as lines of text."""
    summary = material_summary(programme, law)
    lines = [
        f"law {law}; oedometer up to {programme.pressure / 1e3:.4g} kPa",
        f"  {'Heckel slope':<34}{summary['heckel_slope']['value'] * 1e6:>10.4g} 1/MPa",
        f"  {'earth pressure coefficient K0':<34}{programme.earth_pressure_coefficient:>10.4f}",
        f"{'specimen':<36}{'loose':>10}{'compacted':>12}",
    ]
    names = (
        ("density_ratio", "density ratio", 1.0, ""),
        ("unconfined_strength", "unconfined strength", 1e-3, "kPa"),
        ("shear_strength", "shear strength at constant volume", 1e-3, "kPa"),
        ("friction_angle", "friction angle of biaxial tests", 1.0, "degrees"),
        ("cohesion", "cohesion of biaxial tests", 1e-3, "kPa"),
    )
    for key, words, factor, unit in names:
        loose, compacted = (summary["specimens"][each][key]["value"] * factor for each in ("loose", "compacted"))
        lines.append(f"  {words:<34}{loose:>10.4g}{compacted:>12.4g} {unit}".rstrip())
    return "\n".join(lines)


def path_rows(tests: Sequence[MaterialTest]) -> Iterator[tuple[Any, ...]]:
    """Yield the points of the paths of tests, in the columns of HEADER."""
    for test in tests:
        columns = (
            test.axial_strain, test.volume_strain, test.axial_stress, test.lateral_stress, test.transverse_stress,
            test.mean_pressure, test.shear_stress, test.density_ratio,
        )  # fmt: skip
        for values in zip(*(column.tolist() for column in columns), strict=True):
            yield test.name, test.specimen, test.lateral_pressure, *values
