"""Laboratory tests of a mix in a directory: material.csv, material.json, material.png, and their digest."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest
from compact.files import write_csv, write_figure, write_json
from compact.report.figures import DASHES, PALETTE, panels
from compact.report.tables import json_number

HEADER = (
    "test", "specimen", "lateral_pressure_Pa", "axial_strain", "volume_strain", "axial_stress_Pa", "lateral_stress_Pa",
    "transverse_stress_Pa", "mean_pressure_Pa", "von_mises_stress_Pa", "density_ratio",
)  # fmt: skip
PATH = (
    "axial_strain", "volume_strain", "axial_stress", "lateral_stress", "transverse_stress", "mean_pressure",
    "shear_stress", "density_ratio",
)  # fmt: skip
DIGEST = (  # result of a specimen: words, factor and unit of the digest
    ("density_ratio", "density ratio", 1.0, ""),
    ("unconfined_strength", "unconfined strength", 1e-3, "kPa"),
    ("shear_strength", "shear strength at constant volume", 1e-3, "kPa"),
    ("friction_angle", "friction angle of biaxial tests", 1.0, "degrees"),
    ("cohesion", "cohesion of biaxial tests", 1e-3, "kPa"),
)
KPA = 1e-3  # [kPa/Pa]
SPECIMEN_COLOURS = {"loose": PALETTE[0], "compacted": PALETTE[1]}
PANEL = (4.4, 3.1)  # [inch]


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
    write_json(directory / "material.json", material_summary(programme, law))
    figure = write_figure(directory / "material.png", draw_material_tests(programme))
    return [table, directory / "material.json", figure]


def path_rows(tests: Sequence[MaterialTest]) -> Iterator[tuple[Any, ...]]:
    """Yield the points of the paths of tests, in the columns of HEADER."""
    for test in tests:
        for values in zip(*(getattr(test, name).tolist() for name in PATH), strict=True):
            yield test.name, test.specimen, test.lateral_pressure, *values


def material_summary(programme: LaboratoryProgramme, law: str) -> dict[str, Any]:
    """Return the results of all tests for material.json, in SI units and degrees."""
    specimens = {}
    for specimen, ratio in (("loose", programme.material.fed_density_ratio), ("compacted", programme.density_ratio)):
        angle, cohesion = programme.mohr_coulomb(specimen)
        specimens[specimen] = {
            "density_ratio": json_number(float(ratio), "1"),
            "unconfined_strength": json_number(programme.test("unconfined", specimen).strength, "Pa"),
            "shear_strength": json_number(programme.test("pure shear", specimen).strength / 2, "Pa"),
            "friction_angle": json_number(angle, "deg"),
            "cohesion": json_number(cohesion, "Pa"),
        }
    return {
        "law": law,
        "heckel_slope": json_number(programme.heckel_slope(), "1/Pa"),
        "earth_pressure_coefficient": json_number(programme.earth_pressure_coefficient, "1"),
        "pressure": json_number(programme.pressure, "Pa"),
        "specimens": specimens,
    }


def material_digest(programme: LaboratoryProgramme, law: str) -> str:
    """Return the results of all tests as lines of text."""
    summary = material_summary(programme, law)
    lines = [
        f"law {law}; oedometer up to {programme.pressure / 1e3:.4g} kPa",
        f"  {'Heckel slope':<34}{summary['heckel_slope']['value'] * 1e6:>10.4g} 1/MPa",
        f"  {'earth pressure coefficient K0':<34}{programme.earth_pressure_coefficient:>10.4f}",
        f"{'specimen':<36}{'loose':>10}{'compacted':>12}",
    ]
    for key, words, factor, unit in DIGEST:
        loose, compacted = (each[key]["value"] * factor for each in summary["specimens"].values())
        lines.append(f"  {words:<34}{loose:>10.4g}{compacted:>12.4g} {unit}".rstrip())
    return "\n".join(lines)


def draw_material_tests(programme: LaboratoryProgramme) -> Figure:
    """Draw density and lateral stress of the oedometer, shear tests over the strain, and paths in p and q."""
    figure, ((compression, pressure), (shear, paths)) = panels(2, 2, PANEL, gaps=(0.85, 0.75), top=0.3)
    test, isotropic, material = programme.test("oedometer"), programme.test("isotropic"), programme.material
    _plot(compression, test.axial_stress, test.density_ratio, PALETTE[0], "oedometer, vertical stress")
    _plot(compression, isotropic.axial_stress, isotropic.density_ratio, PALETTE[2], "isotropic compression")
    if material.heckel_test == "confined":
        stress = np.linspace(0, programme.pressure, 200)
        heckel = 1 - (1 - material.loose_density_ratio) * np.exp(-material.heckel_slope * stress)
        shown = heckel > material.fed_density_ratio
        _plot(compression, stress[shown], heckel[shown], "black", "Heckel's curve", ":")
    compression.set(xlabel="stress [kPa]", ylabel="density ratio k [-]")
    _plot(pressure, test.axial_stress, test.lateral_stress * KPA, PALETTE[0], "oedometer and release")
    end, ratio = programme.pressure, programme.earth_pressure_coefficient
    _plot(pressure, np.array([0, end]), [0, ratio * end * KPA], "0.5", f"K0 = {ratio:.3f}", ":")
    pressure.set(xlabel="vertical stress [kPa]", ylabel="lateral stress [kPa]")
    dashes: dict[tuple[str, float], Any] = {}
    for each in (each for each in programme.tests if each.name not in ("oedometer", "isotropic")):
        colour, name = SPECIMEN_COLOURS[each.specimen], each.name
        words = name if name == "unconfined" else f"{name}, {each.lateral_pressure * KPA:.3g} kPa"
        dash = dashes.setdefault((name, each.lateral_pressure), DASHES[len(dashes) % len(DASHES)])
        label = words if each.specimen == "loose" else None
        shear.plot(each.axial_strain * 100, each.deviator_stress * KPA, color=colour, linestyle=dash, label=label)
        paths.plot(each.mean_pressure * KPA, each.shear_stress * KPA, color=colour, linewidth=1.0)
        paths.plot(each.mean_pressure[-1] * KPA, each.shear_stress[-1] * KPA, "o", color=colour, markersize=3.5)
    shear.set(xlabel="axial strain [%]", ylabel="axial less lateral stress [kPa]")
    ratios = material.fed_density_ratio, programme.density_ratio
    shear.set_title("blue: loose, k {:.3g}; orange: compacted, k {:.3g}".format(*ratios), fontsize=9)
    _plot(paths, test.mean_pressure, test.shear_stress * KPA, "black", "oedometer and release")
    paths.set(xlabel="mean pressure p [kPa]", ylabel="von Mises stress q [kPa]")
    for ax in (compression, pressure, shear, paths):
        ax.legend(frameon=False, fontsize=8 if ax is shear else None)
    return figure


def _plot(ax: Axes, stress: Any, values: Any, colour: str, label: str, dash: str = "-") -> None:
    """Draw values over a stress [Pa]."""
    ax.plot(stress * KPA, values, color=colour, linestyle=dash, label=label)


def draw_stress_strain(tests: Sequence[MaterialTest]) -> Figure:
    """Draw the axial stress over the axial strain of compression tests, and of shear tests."""
    figure, (both,) = panels(1, 2, PANEL, gaps=(0.85, 0.0))
    compressed = [test for test in tests if test.name in ("oedometer", "isotropic")]
    for ax, shown in zip(both, (compressed, [test for test in tests if test not in compressed]), strict=True):
        for color, test in zip(PALETTE, shown, strict=False):
            label = f"{test.name}, {test.lateral_pressure * KPA:.4g} kPa" if test.lateral_pressure else test.name
            ax.plot(1e2 * test.axial_strain, test.axial_stress * KPA, color=color, label=label)
        ax.set(xlabel="axial strain [%]", ylabel="axial stress [kPa]")
        ax.legend(frameon=False, fontsize="small")
    return figure
