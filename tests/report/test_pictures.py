"""Pictures of fields by pyvista of the extra `view`, off screen, in slow tests."""

import sys
from pathlib import Path
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from compact.engines import ENGINES
from compact.files import ResultsError
from compact.report import pictures
from compact.rolling_contact import Layer, Roller

LEFT, RIGHT = 0.9, 0.98  # [-], density ratios of the two halves of the layer


@pytest.fixture(scope="module")
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


@pytest.fixture(scope="module")
def contact():
    return SimpleNamespace(
        layer=Layer(0.1), roller=Roller(0.11, indentation=0.01), indentation=0.01, leading=0.045, trailing=-0.015
    )


@pytest.mark.slow
def test_picture_shows_both_densities_the_roller_and_the_paper(layer, contact):
    colours = pictures.render_fields(layer, contact, size=(400, 200))
    assert colours.shape == (200, 400, 3)
    at = {name: colours[row, column].astype(int) for name, (row, column) in {
        "left": (120, 40), "right": (120, 360), "roller": (20, 200), "paper": (10, 5)}.items()}  # fmt: skip
    assert at["paper"].tolist() == [255, 255, 255]
    assert np.ptp(at["roller"]) == 0
    assert 200 < at["roller"][0] < 255
    assert at["right"].sum() > at["left"].sum() + 200  # cividis is lighter for denser mix


@pytest.mark.slow
def test_displaced_grid_keeps_data_and_moves_points(layer):
    grid = pictures.displaced_grid(layer)
    assert grid.bounds[2:4] == pytest.approx((-0.01, 0.09))
    assert grid.cell_data["density_ratio"].max() == RIGHT


def test_unknown_field_is_refused_with_the_known_ones(layer):
    with pytest.raises(ValueError, match="the layer has the fields density_ratio, got 'heat'"):
        pictures.shown_field(layer, "heat")


def test_picture_is_refused_before_the_contact(monkeypatch):
    fem = ENGINES["fem"]
    with pytest.raises(ValueError, match=r"--picture takes a file that ends in .png, .* got 'a.vtu'"):
        pictures.require_picture(Path("a.vtu"), fem)
    with pytest.raises(ValueError, match="the engine column computes no fields"):
        pictures.require_picture(Path("a.png"), ENGINES["column"])
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ResultsError, match=r"pip install 'compact\[view\]'"):
        pictures.require_picture(Path("a.png"), fem)
