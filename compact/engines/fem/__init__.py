"""Viscoelastic layer under a rolling cylinder by plane-strain finite elements."""
