"""Laboratory tests of a mix or an own material: table, results in material.json, figure, and a digest as text."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest
from compact.files import write_figure, write_json
from compact.material.laws import Compaction
from compact.quantities import Quantity
from compact.report.figures import DASHES, PALETTE, panels
from compact.report.tables import WORD, TableSpec, format_quantity, json_number

STRESS, SHARE = Quantity("stress", "Pa", "kPa"), Quantity("", "1")
PATH = {  # columns of a point of a path
    "axial_strain": SHARE, "volume_strain": SHARE, "axial_stress": STRESS, "lateral_stress": STRESS,
    "transverse_stress": STRESS, "mean_pressure": STRESS, "von_mises_stress": STRESS, "density_ratio": SHARE,
}  # fmt: skip
KPA = 1e-3  # [kPa/Pa]
SPECIMEN_COLOURS = {"loose": PALETTE[0], "compacted": PALETTE[1]}
PANEL = (4.4, 3.1)  # [inch]


def path_table(tests: Sequence[MaterialTest], title: str = "") -> TableSpec:
    """Return the points of the paths of tests in one table."""
    rows = [
        (test.name, test.specimen, test.lateral_pressure, *point)
        for test in tests
        for point in np.transpose([getattr(test, name) for name in PATH]).tolist()
    ]
    return TableSpec(title, {"test": WORD, "specimen": WORD, "lateral_pressure": STRESS} | PATH, rows)


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
    table = path_table(programme.tests).write(directory / "material.csv")
    summary = write_json(directory / "material.json", material_summary(programme, law))
    return [table, summary, write_figure(directory / "material.png", draw_material_tests(programme))]


def material_summary(programme: LaboratoryProgramme, law: str) -> dict[str, Any]:
    """Return the results of all tests for material.json, in SI units and degrees."""
    specimens = {}
    for specimen, ratio in programme.specimens.items():
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


def material_digest(summary: dict[str, Any]) -> str:
    """Return the results of `material_summary` as lines of text."""
    specimens = summary["specimens"]
    rows = {name: [summary[name]] for name in ("heckel_slope", "earth_pressure_coefficient")}
    rows |= {name: [each[name] for each in specimens.values()] for name in specimens["loose"]}
    lines = [
        f"law {summary['law']}; oedometer up to {summary['pressure']['value'] * KPA:.4g} kPa; {', '.join(specimens)}"
    ]
    for name, cells in rows.items():
        values = "".join(f"{format_quantity(cell['value'], cell['unit']):>18}" for cell in cells)
        lines.append(f"  {name.replace('_', ' '):<28}{values}")
    return "\n".join(lines)


def draw_material_tests(programme: LaboratoryProgramme) -> Figure:
    """Draw density and lateral stress of the oedometer, shear tests over the strain, and paths in p and q."""
    figure, ((compression, pressure), (shear, paths)) = panels(2, 2, PANEL, (0.85, 0.75), top=0.3)
    test, isotropic, material = programme.test("oedometer"), programme.test("isotropic"), programme.material
    compression.plot(test.axial_stress * KPA, test.density_ratio, label="oedometer, vertical stress")
    compression.plot(
        isotropic.axial_stress * KPA, isotropic.density_ratio, color=PALETTE[2], label="isotropic compression"
    )
    if isinstance(material, Compaction) and material.heckel_test == "confined":
        stress = np.linspace(0, programme.pressure, 200)
        heckel = 1 - (1 - material.loose_density_ratio) * np.exp(-material.heckel_slope * stress)
        shown = heckel > material.fed_density_ratio
        compression.plot(stress[shown] * KPA, heckel[shown], ":", color="black", label="Heckel's curve")
    compression.set(xlabel="stress [kPa]", ylabel="density ratio k [-]")
    pressure.plot(test.axial_stress * KPA, test.lateral_stress * KPA, label="oedometer and release")
    end, ratio = programme.pressure * KPA, programme.earth_pressure_coefficient
    pressure.plot([0, end], [0, ratio * end], ":", color="0.5", label=f"K0 = {ratio:.3f}")
    pressure.set(xlabel="vertical stress [kPa]", ylabel="lateral stress [kPa]")
    dashes: dict[tuple[str, float], Any] = {}
    for each in (each for each in programme.tests if each.name not in ("oedometer", "isotropic")):
        colour, name = SPECIMEN_COLOURS[each.specimen], each.name
        words = name if name == "unconfined" else f"{name}, {each.lateral_pressure * KPA:.3g} kPa"
        dash = dashes.setdefault((name, each.lateral_pressure), DASHES[len(dashes) % len(DASHES)])
        label = words if each.specimen == "loose" else None
        shear.plot(each.axial_strain * 100, each.deviator_stress * KPA, color=colour, linestyle=dash, label=label)
        p, q = each.mean_pressure * KPA, each.von_mises_stress * KPA
        paths.plot(p, q, "-o", color=colour, linewidth=1.0, markersize=3.5, markevery=[-1])
    shear.set(xlabel="axial strain [%]", ylabel="axial less lateral stress [kPa]")
    colours = zip(("blue", "orange"), programme.specimens.items(), strict=False)
    words = "; ".join(f"{colour}: {name}, k {ratio:.3g}" for colour, (name, ratio) in colours)
    shear.set_title(words, fontsize=9)
    paths.plot(test.mean_pressure * KPA, test.von_mises_stress * KPA, color="black", label="oedometer and release")
    paths.set(xlabel="mean pressure p [kPa]", ylabel="von Mises stress q [kPa]")
    for ax in (compression, pressure, shear, paths):
        ax.legend(frameon=False, fontsize=8 if ax is shear else None)
    return figure
