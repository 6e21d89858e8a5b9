"""Numerical methods without knowledge of rollers: checks, quadrature, roots, convex programs, element matrices."""
