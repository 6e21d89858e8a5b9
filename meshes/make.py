"""Three graded layers for the default scene (height 0.22 m, contact half-width 20 mm): coarse, medium, fine.

The medium one is the default mesh of the engine "fem"; run again after a change of `compact.mesh`.
"""

from pathlib import Path

from compact.mesh import graded_mesh, write_row_mesh

HEIGHT, HALF_WIDTH = 0.22, 0.02
ELEMENTS = {"coarse": 5, "medium": 10, "fine": 20}


def main(out: Path = Path(__file__).parent) -> dict[str, int]:
    """Write the three meshes and return their unknowns by name."""
    dofs = {}
    for name, elements in ELEMENTS.items():
        layer = graded_mesh(HEIGHT, HALF_WIDTH, elements)
        write_row_mesh(layer, Path(out) / f"{name}.vtu")
        dofs[name] = layer.dofs
    return dofs


if __name__ == "__main__":
    for name, dofs in main().items():
        print(f"{name:<8}{dofs:>8} displacements")
