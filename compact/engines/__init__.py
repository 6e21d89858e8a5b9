"""Contact engines: half-plane theory, columns, spectral layer, linear finite elements, compacting finite elements."""
