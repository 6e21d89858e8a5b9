"""Viscoelastic layer under a rolling cylinder by a Galerkin method in Jacobi polynomials."""
