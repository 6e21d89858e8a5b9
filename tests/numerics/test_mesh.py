"""Row meshes: shape, grading, refinement, files, and errors for rows that are not straight."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact import mesh
from compact.mesh import RowMesh, graded_mesh, row_mesh

LAYER = graded_mesh(height=0.22, half_width=0.02, elements=10)
SMALL = RowMesh(np.array([[0.0, 1.0, 2.5], [0.0, 1.2, 2.5], [0.1, 1.3, 2.4]]), np.array([0.0, 0.5, 0.8]))


def area(row_mesh):
    """Shoelace formula over the corners of every element."""
    x, y = row_mesh.points[row_mesh.quads].transpose(2, 0, 1)
    return 0.5 * np.sum(x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1), axis=1)


def shuffled(row_mesh, rng):
    """Points and quads of a mesh in random order."""
    order = rng.permutation(len(row_mesh.points))
    points = np.empty_like(row_mesh.points)
    points[order] = row_mesh.points
    quads = order[row_mesh.quads][rng.permutation(len(row_mesh.quads))]
    return points, np.array([np.roll(quad, rng.integers(4)) for quad in quads])


# closed form


def test_elements_fill_the_rectangle():
    width = np.ptp(LAYER.x)
    assert area(LAYER).min() > 0
    assert area(LAYER).sum() == pytest.approx(width * 0.22, rel=1e-12)


def test_dofs_are_those_of_nine_node_elements():
    rows, columns = LAYER.shape
    assert LAYER.dofs == 2 * (2 * rows + 1) * (2 * columns + 1)


def test_mesh_size_is_the_longest_edge():
    assert SMALL.mesh_size == pytest.approx(1.5)


# grading


def test_contact_edges_are_nodes():
    assert np.abs(LAYER.x[-1] - 0.02).min() < 1e-16
    assert np.abs(LAYER.x[-1] + 0.02).min() < 1e-16


def test_elements_shrink_to_the_edges_and_the_surface():
    sizes, x = np.diff(LAYER.x[-1]), LAYER.x[-1]
    at_edge = sizes[np.argmin(np.abs(x - 0.02))]
    assert at_edge == pytest.approx(0.02 / 10 / 4, rel=0.2)
    assert sizes[np.argmin(np.abs(x))] == pytest.approx(0.02 / 10, rel=0.2)
    assert np.diff(LAYER.y)[-1] == pytest.approx(0.02 / 10 / 4, rel=0.2)
    assert np.all(np.diff(np.diff(LAYER.y)) < 1e-15)


def test_ratio_of_neighbours_is_at_most_the_growth():
    for sizes in (np.diff(LAYER.x[-1]), np.diff(LAYER.y)):
        ratio = np.maximum(sizes[1:] / sizes[:-1], sizes[:-1] / sizes[1:])
        assert ratio.max() < 1.3 * mesh.GROWTH


@given(st.floats(1e-3, 1e3), st.floats(1e-4, 20.0), st.floats(1, 30))
def test_any_layer_is_covered_and_symmetric(height, ratio, elements):
    half_width = ratio * height
    layer = graded_mesh(height, half_width, elements)
    x = layer.x[-1]
    assert layer.y[0] == 0
    assert layer.height == pytest.approx(height, rel=1e-12)
    assert x[-1] == pytest.approx(half_width + mesh.REACH * height, rel=1e-9)
    assert np.array_equal(x, -x[::-1])
    assert np.diff(layer.y).max() <= mesh.MAX_SIZE * height * (1 + 1e-9)


@pytest.mark.parametrize(("error", "elements"), [(2e-3, 10), (2.5e-4, 40), (1, 4), (1e-9, 80)])
def test_tolerance_sets_the_elements(error, elements):
    assert mesh.mesh_for_error(0.22, 0.02, error) == graded_mesh(0.22, 0.02, elements)


# equality and refinement


def test_meshes_of_the_same_nodes_are_equal():
    again = graded_mesh(height=0.22, half_width=0.02, elements=10)
    assert again == LAYER
    assert hash(again) == hash(LAYER)
    assert LAYER != SMALL
    assert LAYER != "mesh"


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        LAYER.x[0, 0] = 1.0


def test_refinement_divides_every_element_into_four():
    fine = SMALL.refined()
    assert fine.shape == (4, 4)
    assert area(fine).reshape(2, 2, 2, 2).sum(axis=(1, 3)).ravel() == pytest.approx(area(SMALL), rel=1e-12)


def test_graded_and_refined_layers_are_symmetric():
    assert LAYER.mirrored
    assert LAYER.refined().mirrored
    assert not SMALL.mirrored


# files and meshes of users


@pytest.mark.parametrize("suffix", ["vtu", "msh", "vtk", "inp"])
def test_mesh_is_read_as_written(tmp_path, suffix):
    mesh.write_row_mesh(SMALL, tmp_path / f"layer.{suffix}")
    again = mesh.read_mesh(tmp_path / f"layer.{suffix}")
    assert again.x == pytest.approx(SMALL.x, rel=1e-12)
    assert again.y == pytest.approx(SMALL.y, rel=1e-12)


@pytest.mark.parametrize("layer", [LAYER, SMALL], ids=["graded", "skewed"])
def test_rows_are_found_in_any_numbering(layer):
    assert row_mesh(*shuffled(layer, np.random.default_rng(1))) == layer


@pytest.mark.parametrize("size", ["coarse", "medium", "fine"])
def test_shipped_meshes_are_layers_of_the_default_scene(size):
    from pathlib import Path

    shipped = mesh.read_mesh(Path(__file__).parents[2] / "meshes" / f"{size}.vtu")
    assert shipped.height == pytest.approx(0.22)
    assert shipped.dofs > 1000


# errors


def test_skewed_row_raises_an_error():
    points = SMALL.points
    points[4, 1] += 0.1
    with pytest.raises(ValueError, match=r"rows must be straight: the corners of element 0 lie at the heights \[0.0"):
        row_mesh(points, SMALL.quads)


def test_hole_raises_an_error():
    fine = SMALL.refined()
    with pytest.raises(ValueError, match="without gap or overlap: 16 expected between neighbouring nodes, 15 got, 15"):
        row_mesh(fine.points, np.delete(fine.quads, 5, axis=0))


def test_lines_of_unequal_length_raise_an_error():
    quads = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6]])
    with pytest.raises(ValueError, match="must have equally many nodes, got 3, 3, 2 from the base upwards"):
        row_mesh(SMALL.points, quads)


def test_triangles_raise_an_error():
    with pytest.raises(ValueError, match=r"`quads` must be quadrilaterals of 4 corners, got shape \(1, 3\)"):
        row_mesh(SMALL.points, [[0, 1, 2]])


def test_file_of_triangles_raises_an_error(tmp_path):
    import meshio

    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(tmp_path / "t.vtu")
    with pytest.raises(ValueError, match="the elements must be quadrilaterals of 4 corners, got triangle"):
        mesh.read_mesh(tmp_path / "t.vtu")


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([[0, 1], [0, 1]], [0.1, 1], "the base must lie at `y` = 0, got 0.1"),
        ([[0, 1], [1, 0]], [0, 1], "`x` must increase along every line, line 1 does not"),
        ([[0, 1], [0, 1]], [0, 0], "`y` must increase from the base up"),
        ([[0, 1], [0, 1]], [0, 1, 2], "`x` must have one line of at least two nodes for each of `y`"),
        ([[0, 1], [0, np.nan]], [0, 1], "`x` and `y` must be finite"),
    ],
    ids=["base", "turned", "flat", "shape", "nan"],
)
def test_nodes_off_the_rows_raise_an_error(x, y, message):
    with pytest.raises(ValueError, match=message):
        RowMesh(np.array(x, dtype=float), np.array(y, dtype=float))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"height": 0.0}, "`height` must be positive and finite, got 0.0"),
        ({"half_width": np.nan}, "`half_width` must be positive and finite, got nan"),
        ({"growth": 0.9}, "`growth` must be at least 1 and finite, got 0.9"),
        ({"edge": 0.5}, "`edge` must be at least 1 and finite, got 0.5"),
    ],
    ids=["height", "half_width", "growth", "edge"],
)
def test_impossible_grading_raises_an_error(arguments, message):
    with pytest.raises(ValueError, match=message):
        graded_mesh(**({"height": 0.2, "half_width": 0.02, "elements": 10} | arguments))
