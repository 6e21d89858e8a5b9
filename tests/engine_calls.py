"""Functions of the engines by name."""

from compact.engines import formula
from compact.engines.column import engine as column
from compact.engines.compaction import engine as compaction
from compact.engines.fem import engine as fem_engine
from compact.engines.fem import speed_derivative as fem_derivative
from compact.engines.spectral import engine as spectral
from compact.engines.spectral import speed_derivative as spectral_derivative

ROLL = {
    "formula": formula.roll, "column": column.roll, "spectral": spectral.roll, "fem": fem_engine.roll,
    "compaction": compaction.roll,
}  # fmt: skip
EXPAND = {"spectral": spectral_derivative.expand_resistance, "fem": fem_derivative.expand_resistance}
COMPACTING = ("column", "compaction")


def expand_resistance(layer, roller, material, speed, engine="spectral", **accuracy):
    """Expand the resistance by an engine with memory in time."""
    return EXPAND[engine](layer, roller, material, speed, **accuracy)
