"""Row meshes: shape, grading, refinement, files, and errors for rows that are not straight."""

import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from compact import mesh
from compact.mesh import RowMesh, graded_mesh

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


def test_elements_of_nine_nodes_fill_the_rectangle():
    assert area(LAYER).min() > 0
    assert area(LAYER).sum() == pytest.approx(np.ptp(LAYER.x) * 0.22, rel=1e-12)
    rows, columns = LAYER.shape
    assert LAYER.dofs == 2 * (2 * rows + 1) * (2 * columns + 1)


# grading


def test_elements_shrink_to_the_edges_and_the_surface():
    sizes, x = np.diff(LAYER.x[-1]), LAYER.x[-1]
    assert [np.abs(x - edge).min() < 1e-16 for edge in (0.02, -0.02)] == [True, True]  # nodes
    at_edge = sizes[np.argmin(np.abs(x - 0.02))]
    assert at_edge == pytest.approx(0.02 / 10 / 4, rel=0.2)
    assert sizes[np.argmin(np.abs(x))] == pytest.approx(0.02 / 10, rel=0.2)
    assert np.diff(LAYER.y)[-1] == pytest.approx(0.02 / 10 / 4, rel=0.2)
    assert np.all(np.diff(np.diff(LAYER.y)) < 1e-15)
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


# equality and refinement


def test_refinement_divides_every_element_into_four():
    fine = SMALL.refined()
    assert fine.shape == (4, 4)
    assert area(fine).reshape(2, 2, 2, 2).sum(axis=(1, 3)).ravel() == pytest.approx(area(SMALL), rel=1e-12)
    assert [mesh.mirrored for mesh in (LAYER, LAYER.refined(), SMALL)] == [True, True, False]


# files and meshes of users


def read(directory, points, quads):
    """Mesh of points and quadrilaterals, read from a file."""
    path = directory / "given.vtu"
    meshio.Mesh(np.pad(points, ((0, 0), (0, 3 - np.shape(points)[1]))), [("quad", np.asarray(quads))]).write(path)
    return mesh.read_mesh(path)


@pytest.mark.parametrize("suffix", ["vtu", "msh", "vtk", "inp"])
def test_mesh_is_read_as_written(tmp_path, suffix):
    mesh.write_row_mesh(SMALL, tmp_path / f"layer.{suffix}")
    again = mesh.read_mesh(tmp_path / f"layer.{suffix}")
    assert again.x == pytest.approx(SMALL.x, rel=1e-12)
    assert again.y == pytest.approx(SMALL.y, rel=1e-12)


@pytest.mark.parametrize("layer", [LAYER, SMALL], ids=["graded", "skewed"])
def test_rows_are_found_in_any_numbering(layer, tmp_path):
    assert read(tmp_path, *shuffled(layer, np.random.default_rng(1))) == layer


# refusals

RAISED = SMALL.points + 0.1 * np.eye(9)[4][:, None] * [0, 1]
FINE, FLAT = SMALL.refined(), [[0, 1], [0, 1]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: RowMesh(FLAT, [0.1, 1]), "the base must lie at `y` = 0, got 0.1"),
        (lambda: RowMesh([[0, 1], [1, 0]], [0, 1]), "`x` must increase along every line, got"),
    ],
)
def test_nodes_off_the_rows_and_impossible_gradings_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    ("points", "quads"),
    [
        (RAISED, SMALL.quads),
        (FINE.points, np.delete(FINE.quads, 5, axis=0)),
        (SMALL.points, [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6]]),
    ],
    ids=["raised", "hole", "corner"],
)
def test_elements_that_do_not_fill_rows_are_refused(points, quads, tmp_path):
    with pytest.raises(ValueError, match="must fill straight rows without gap or overlap"):
        read(tmp_path, points, quads)
