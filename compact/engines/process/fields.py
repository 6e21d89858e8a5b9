"""Fields of a forming process along the roller, as meshes of rectangles in z (along the roller) and y (height).

In two dimensions the rows of a section are those of the lumped lifts at its mean density.

Frame n shows the mould after the n-th stroke since its start: the first section has had n strokes and lies farthest
from the empty mould, and loose fill follows it.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from compact.engines.process.lifts import LiftSequence
from compact.engines.process.roller_row import RollerRow
from compact.engines.process.section import SectionState

if TYPE_CHECKING:
    import meshio

FRAMES_MAX = 60  # [-], frames of a series; later strokes are shown at equal intervals
FILL_SHARE = 0.15  # [-], length of the fill shown in front of the roller over that of the roller


def process_frames(row: RollerRow, lifts: LiftSequence | None = None) -> Iterator[tuple[float, "meshio.Mesh"]]:
    """Yield the number of strokes since the start, and the fields.

    Cell data: density ratio [-], lateral stress at rest [Pa], number of strokes.

    Parameters
    ----------
    row : RollerRow
        Forming process of one roller.
    lifts : LiftSequence, optional
        Lumped lifts; without them the layers of the columns are shown.

    Yields
    ------
    number, mesh : float and meshio.Mesh
    """
    count = row.history.count
    numbers = np.unique(np.linspace(1, count, min(count, FRAMES_MAX)).round().astype(int))
    for number in numbers.tolist():
        yield float(number), _frame(row, number, lifts)


def _frame(row: RollerRow, number: int, lifts: LiftSequence | None) -> "meshio.Mesh":
    """Return the mesh after a number of strokes since the start."""
    import meshio

    machine, states = row.problem.machine, row.history.states
    if machine.strokes is not None:
        pieces = [(0.0, machine.roller_length, number, states[number])]
    else:
        edges = machine.edges
        pieces = [(float(edges[n - 1]), float(edges[n]), n, states[n]) for n in range(1, number + 1)]
        pieces.insert(0, (-FILL_SHARE * machine.roller_length, 0.0, 0, states[0]))
    points, values = [], []
    for low, high, strokes, state in pieces:
        bottom = 0.0
        for height, ratio, stress in section_rows(state, lifts):
            top = bottom + height
            points += [(low, bottom, 0.0), (high, bottom, 0.0), (high, top, 0.0), (low, top, 0.0)]
            values.append((ratio, stress, float(strokes)))
            bottom = top
    cells = np.arange(len(points)).reshape(-1, 4)
    ratio, stress, strokes_on = np.array(values).T
    data = {"density_ratio": [ratio], "lateral_stress": [stress], "strokes": [strokes_on]}
    return meshio.Mesh(np.array(points), [("quad", cells)], cell_data=data)


def section_rows(state: SectionState, lifts: LiftSequence | None) -> Iterator[tuple[float, float, float]]:
    """Yield the rows of a section from the base upwards.

    Parameters
    ----------
    state : SectionState
        Section by columns.
    lifts : LiftSequence or None
        Lumped lifts, whose rows at the mean density of the section replace its layers.

    Yields
    ------
    height, density_ratio, lateral_stress : float
        Height [m], density ratio [-] and lateral stress at rest [Pa].
    """
    if lifts is None:
        yield from ((column.height, column.density_ratio, column.lateral_stress) for column in state.columns)
    else:
        yield from zip(*lifts.profile_at(state.density_ratio).tolist(), strict=True)
