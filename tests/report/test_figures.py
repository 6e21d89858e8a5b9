"""Figures: curves of the laws, labels beyond a scale, common colour scales, distinct colours and marks."""

from itertools import combinations
from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from matplotlib.colors import LogNorm, to_rgb

from compact.analysis.stages.drives import Place
from compact.motion.profile import LAWS
from compact.report import contact_figures, figures
from compact.report.figures import law_style
from compact.rolling_contact import Layer, Roller

LEFT, RIGHT = 0.9, 0.98  # [-], density ratios of the two halves of a layer
COLOURS = {
    "laws": [law_style(name)["color"] for name in LAWS],
    "engines": [shade for shade, _, _ in figures.ENGINE_STYLES.values()],
}
# Machado, Oliveira and Fernandes, IEEE Trans. Vis. Comput. Graph. 15 (2009) 1291, severity 1, on linear RGB
SIGHT = {
    "all cones": np.eye(3),
    "deuteranope": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "protanope": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
}
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def lab(shade, sight="all cones"):
    """CIELAB of an sRGB colour, by IEC 61966-2-1 and CIE 15."""
    c = np.array(to_rgb(shade))
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    t = XYZ @ np.clip(SIGHT[sight] @ linear, 0, 1) / XYZ.sum(axis=1)
    x, y, z = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


# colours


@pytest.mark.parametrize("sight", SIGHT)
@pytest.mark.parametrize("colours", COLOURS.values(), ids=COLOURS)
def test_colours_are_distinct_with_colour_blindness(colours, sight):
    seen = [lab(shade, sight) for shade in colours]
    assert min(np.linalg.norm(one - other) for one, other in combinations(seen, 2)) > 16


# fields


def layer_of(pressure, dissipation, height=0.22, speed=0.1, contact=0.05, base="bonded"):
    """Mesh of two adjacent elements, and its contact."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 5), np.linspace(0, height, 3))
    number = np.arange(15).reshape(3, 5)
    corners = [(0, 0), (0, 2), (2, 2), (2, 0), (0, 1), (1, 2), (2, 1), (1, 0), (1, 1)]
    cells = np.array([[number[row, column + shift] for row, column in corners] for shift in (0, 2)])
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(15)])
    mesh = SimpleNamespace(
        points=points, point_data={"displacement": np.zeros((15, 3))}, cells=[SimpleNamespace(data=cells)],
        cell_data={"pressure": [np.array(pressure)], "dissipation": [np.array(dissipation)]},
    )  # fmt: skip
    rolled = SimpleNamespace(
        layer=Layer(height, base=base), roller=Roller(0.11, indentation=0.01), indentation=0.01, speed=speed,
        leading=contact / 2, trailing=-contact / 2, material=None,
    )  # fmt: skip
    return mesh, rolled


def test_field_has_one_colour_scale_for_all_speeds():
    layers = [layer_of([-1e3, 50e3], [0.0, 1e3], speed=0.01), layer_of([0.0, 140e3], [5.0, 30e3], speed=0.1)]
    figure = contact_figures.draw_fields(layers)
    panels, scales = figure.axes[:4], figure.axes[4:]
    pressures, heats = ([panels[i].collections[0].norm for i in which] for which in ((0, 2), (1, 3)))
    assert [(norm.vmin, norm.vmax) for norm in pressures] == [(-1.0, 140.0)] * 2
    assert all(isinstance(norm, LogNorm) for norm in heats)
    assert [(norm.vmin, norm.vmax) for norm in heats] == [pytest.approx((0.03, 30.0))] * 2
    assert [ax.get_xlabel() for ax in scales] == ["mean pressure [kPa]", "dissipation [kW/m³], black: below the scale"]


@pytest.fixture
def layer():
    """Layer of 0.4 m by 0.1 m that a uniform displacement lowers by 10 mm, denser on the right."""
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(0.0, 0.1, 3), indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    cells = np.stack([each.ravel() for each in corners], axis=1)
    ratio = np.where(x.ravel()[cells].mean(axis=1) < 0, LEFT, RIGHT)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    lowered = {"displacement": np.tile([0.0, -0.01, 0.0], (x.size, 1))}
    return meshio.Mesh(points, [("quad", cells)], lowered, {"density_ratio": [ratio]})


def test_picture_has_the_displaced_elements_with_their_density_and_the_roller(layer):
    rolled = layer_of([0.0, 0.0], [0.0, 0.0], height=0.1, contact=0.06)[1]
    ax, scale = contact_figures.draw_picture(layer, rolled).axes
    (shown,), (roller,) = ax.collections, ax.patches[:1]
    middles = np.array([path.vertices[:4].mean(axis=0) for path in shown.get_paths()])
    assert np.asarray(shown.get_array()) == pytest.approx(np.where(middles[:, 0] < 0, LEFT, RIGHT))
    assert (middles[:, 1].min(), middles[:, 1].max()) == pytest.approx((15.0, 65.0))  # 25 and 75 mm, lowered by 10
    assert roller.center[1] - roller.radius == pytest.approx(90.0)
    assert scale.get_xlabel() == "density ratio k [-]"


# order of the laws


def places(values, error=0.0):
    return [Place(i, name, value, 0.1, error, True, "") for i, (name, value) in enumerate(values.items(), start=1)]


VALUES = {"parabolic": 700.0, "harmonic": 720.0, "reversal-4-free-acceleration": 1100.0}


def test_ranking_has_a_bar_with_its_error_for_each_law():
    figure = figures.draw_rankings({"peak_force": places(VALUES, 5.0)})
    assert [bar.get_width() for bar in figure.axes[0].patches] == pytest.approx([0.7, 0.72, 1.1])
    assert len(figure.axes[0].containers) == 6
