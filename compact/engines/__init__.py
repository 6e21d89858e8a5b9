"""Registry of the contact engines by name: those of this package, then those of other packages.

Only this module has a table of engines. An engine of another package is loaded when first used.
"""

from compact.engines.column import COLUMN
from compact.engines.compaction import COMPACTION
from compact.engines.fem import FEM
from compact.engines.formula import FORMULA
from compact.engines.interface import Engine
from compact.engines.process import PROCESS
from compact.engines.spectral import SPECTRAL
from compact.numerics.validation import Registry

ENGINES: Registry[Engine] = Registry(Engine, "compact.engines", (FORMULA, COLUMN, SPECTRAL, FEM, COMPACTION, PROCESS))
BUILT_IN = ENGINES.own
