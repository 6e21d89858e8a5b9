"""Numerical methods independent of rollers: validation, quadrature, root finding, convex programs, element matrices."""
