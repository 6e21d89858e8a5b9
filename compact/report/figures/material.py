"""Figure of the laboratory tests of a mix: oedometer, earth pressure, shear tests, and paths over mean pressure.

The figure is drawn from finished tests, in the axes of a soil laboratory.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from compact.analysis.material_tests import LaboratoryProgramme, MaterialTest
from compact.report.figures.style import DASHES, PALETTE, panels

KPA = 1e-3  # [kPa/Pa]
SPECIMEN_COLOURS = {"loose": PALETTE[0], "compacted": PALETTE[1]}
PANEL = (4.4, 3.1)  # [inch]


def draw_material_tests(programme: LaboratoryProgramme) -> Figure:
    """Draw density and lateral stress of the oedometer, shear tests over the strain, and paths in p and q.

    Parameters
    ----------
    programme : LaboratoryProgramme
        Tests of one mix.
    """
    figure, axes = panels(2, 2, PANEL, gaps=(0.85, 0.75), top=0.3)
    _draw_compression(axes[0, 0], programme)
    _draw_earth_pressure(axes[0, 1], programme)
    _draw_shear(axes[1, 0], programme)
    _draw_paths(axes[1, 1], programme)
    return figure


def draw_stress_strain(tests: Sequence[MaterialTest]) -> Figure:
    """Draw the axial stress over the axial strain of compression tests, and of shear tests.

    Parameters
    ----------
    tests : sequence of MaterialTest
        Paths.
    """
    figure, (both,) = panels(1, 2, PANEL, gaps=(0.85, 0.0))
    compressed = [test for test in tests if test.name in ("oedometer", "isotropic")]
    for ax, shown in zip(both, (compressed, [test for test in tests if test not in compressed]), strict=True):
        for color, test in zip(PALETTE, shown, strict=False):
            label = f"{test.name}, {test.lateral_pressure * KPA:.4g} kPa" if test.lateral_pressure else test.name
            ax.plot(1e2 * test.axial_strain, test.axial_stress * KPA, color=color, label=label)
        ax.set(xlabel="axial strain [%]", ylabel="axial stress [kPa]")
        ax.legend(frameon=False, fontsize="small")
    return figure


def _draw_compression(ax: Axes, programme: LaboratoryProgramme) -> None:
    """Draw the density ratio over the stress of oedometer and isotropic compression."""
    test, isotropic = programme.test("oedometer"), programme.test("isotropic")
    ax.plot(test.axial_stress * KPA, test.density_ratio, color=PALETTE[0], label="oedometer, vertical stress")
    ax.plot(isotropic.axial_stress * KPA, isotropic.density_ratio, color=PALETTE[2], label="isotropic compression")
    material = programme.material
    stress = np.linspace(0, programme.pressure, 200)
    if material.heckel_test == "confined":
        heckel = 1 - (1 - material.loose_density_ratio) * np.exp(-material.heckel_slope * stress)
        shown = heckel > material.fed_density_ratio
        ax.plot(stress[shown] * KPA, heckel[shown], color="black", linestyle=":", label="Heckel's curve")
    ax.set(xlabel="stress [kPa]", ylabel="density ratio k [-]")
    ax.legend(frameon=False)


def _draw_earth_pressure(ax: Axes, programme: LaboratoryProgramme) -> None:
    """Draw the lateral over the vertical stress of the oedometer, loading and release."""
    test = programme.test("oedometer")
    ax.plot(test.axial_stress * KPA, test.lateral_stress * KPA, color=PALETTE[0], label="oedometer and release")
    end, coefficient = programme.pressure * KPA, programme.earth_pressure_coefficient
    ax.plot([0, end], [0, coefficient * end], color="0.5", linestyle=":", label=f"K0 = {coefficient:.3f}")
    ax.set(xlabel="vertical stress [kPa]", ylabel="lateral stress [kPa]")
    ax.legend(frameon=False)


def _draw_shear(ax: Axes, programme: LaboratoryProgramme) -> None:
    """Draw axial less lateral stress over the axial strain of the shear tests."""
    styles: dict[tuple[str, float], object] = {}
    for test in _shear_tests(programme):
        dashes = styles.setdefault((test.name, test.lateral_pressure), DASHES[len(styles) % len(DASHES)])
        label = _label(test) if test.specimen == "loose" else None
        colour = SPECIMEN_COLOURS[test.specimen]
        ax.plot(test.axial_strain * 100, test.deviator_stress * KPA, color=colour, linestyle=dashes, label=label)
    material = programme.material
    ax.set(xlabel="axial strain [%]", ylabel="axial less lateral stress [kPa]")
    ratios = material.fed_density_ratio, programme.density_ratio
    ax.set_title("blue: loose, k {:.3g}; orange: compacted, k {:.3g}".format(*ratios), fontsize=9)
    ax.legend(frameon=False, fontsize=8)


def _draw_paths(ax: Axes, programme: LaboratoryProgramme) -> None:
    """Draw the paths of the tests over mean pressure and von Mises stress."""
    for test in _shear_tests(programme):
        colour = SPECIMEN_COLOURS[test.specimen]
        ax.plot(test.mean_pressure * KPA, test.shear_stress * KPA, color=colour, linewidth=1.0)
        ax.plot(test.mean_pressure[-1] * KPA, test.shear_stress[-1] * KPA, "o", color=colour, markersize=3.5)
    test = programme.test("oedometer")
    ax.plot(test.mean_pressure * KPA, test.shear_stress * KPA, color="black", label="oedometer and release")
    ax.set(xlabel="mean pressure p [kPa]", ylabel="von Mises stress q [kPa]")
    ax.legend(frameon=False)


def _shear_tests(programme: LaboratoryProgramme) -> list[MaterialTest]:
    """Return the tests of both specimens."""
    return [test for test in programme.tests if test.name not in ("oedometer", "isotropic")]


def _label(test: MaterialTest) -> str:
    """Return the name of a test with its lateral pressure."""
    if test.name == "unconfined":
        return "unconfined"
    return f"{test.name}, {test.lateral_pressure * KPA:.3g} kPa"
