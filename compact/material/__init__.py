"""Material laws of the layer, and prior parameters of the mix with spread and source."""

from compact.material.laws import Compaction, Elastic, Viscoelastic

__all__ = ["Compaction", "Elastic", "Viscoelastic"]
