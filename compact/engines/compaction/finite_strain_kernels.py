"""Compiled kinematics of points and the pass over elements: gradients, strain, stress, nodal forces and stiffness.

The deformation gradients F before and after an increment give dF = F_after F_before^-1 = R U. The strain is ln U, on
which the constitutive law is integrated (`cap_plasticity.integrate_path`). The stress found is rotated and referred to
the reference configuration,

    sigma = R sigma_unrotated R',    P = sigma cof F,    force = int P dN/dX dV.

In closed form, with the mean m, half difference and xy component d of U: ln U = ln(det U)/2 + atanh(|d|/m)/|d| d. Small
strain is the symmetric gradient of the increment, without rotation and with cof F = 1.

Gradients are tuples (xx, xy, yx, yy), g_ij = du_i/dx_j; values of a point are the stress (xx, yy, zz, xy), the density
ratio and the largest density ratio. All derivatives are exact, except at the onset of yielding.
"""

from collections.abc import Callable

import numpy as np

from compact.material.cap_plasticity import integrate_path
from compact.numerics import Array, IntArray
from compact.numerics.jit import compiled, inlined, internal, is_compiled

SERIES_LIMIT = 1e-4  # [-], half the logarithm of the stretch ratio; below it atanh(z)/z is 1 + z^2/3 to rounding

Gradient = tuple[float, float, float, float]


def announce_compilation(report: Callable[[str], None] | None) -> None:
    """Report, by a function of a line of text, that the kernels are not compiled yet."""
    if report is not None and not is_compiled(integrate_elements):
        report("compiling the kernels of `compaction`, once, some 10 s")


@inlined
def strain_increment(before: Gradient, after: Gradient, finite: bool) -> tuple:
    """Compute the strain of an increment between two displacement gradients.

    Parameters
    ----------
    before, after : tuple of float
        Displacement gradients [-].
    finite : bool
        True for finite strain, False for small strain.

    Returns
    -------
    valid : bool
        False if an element inverts.
    strain : tuple of float
        Strain (xx, yy, 2 xy) [-].
    volume : float
        Volume ratio in the middle of the increment [-].
    cosine, sine : float
        Components of the rotation [-].
    """
    if not finite:
        strain = (after[0] - before[0], after[3] - before[3], after[1] + after[2] - before[1] - before[2])
        return True, strain, 1.0, 1.0, 0.0
    volume, volume_before, (xx, xy, yx, yy), _ = _relative_gradient(before, after)
    mean, half, cross, c, s = _stretch(xx, xy, yx, yy)
    ratio = np.sqrt(half * half + cross * cross) / mean
    factor = (np.arctanh(ratio) / ratio if ratio > SERIES_LIMIT else 1 + ratio * ratio / 3) / mean
    half_volume = np.log(volume / volume_before) / 2
    strain = (half_volume + factor * half, half_volume - factor * half, 2 * factor * cross)
    return volume > 0 and volume_before > 0, strain, np.sqrt(volume * volume_before), c, s


@internal
def _relative_gradient(before, after):
    """Return det F after and before, the relative gradient dF, and the inverse of F before."""
    axx, axy, ayx, ayy = 1 + after[0], after[1], after[2], 1 + after[3]
    bxx, bxy, byx, byy = 1 + before[0], before[1], before[2], 1 + before[3]
    volume, volume_before = axx * ayy - axy * ayx, bxx * byy - bxy * byx
    bxx, bxy, byx, byy = byy / volume_before, -bxy / volume_before, -byx / volume_before, bxx / volume_before
    relative = (axx * bxx + axy * byx, axx * bxy + axy * byy, ayx * bxx + ayy * byx, ayx * bxy + ayy * byy)
    return volume, volume_before, relative, (bxx, bxy, byx, byy)


@internal
def _stretch(xx, xy, yx, yy):
    """Return mean, half difference and xy component of U, and cosine and sine of R, for dF = R U."""
    size = np.sqrt((xx + yy) ** 2 + (yx - xy) ** 2)
    c, s = (xx + yy) / size, (yx - xy) / size
    return size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2, c, s


@inlined
def strain_derivatives(before: Gradient, after: Gradient, finite: bool, derivatives: Array) -> None:
    """Write the derivatives of strain and rotation angle by the gradient after the increment.

    Parameters
    ----------
    before, after : tuple of float
        Displacement gradients [-].
    finite : bool
        True for finite strain, False for small strain.
    derivatives : ndarray, shape (4, 4)
        Output, derivatives of (xx, yy, 2 xy, angle) by the gradient after the increment.
    """
    if not finite:
        derivatives[:] = 0.0
        derivatives[0, 0] = derivatives[1, 3] = derivatives[2, 1] = derivatives[2, 2] = 1.0
        return
    _, _, (xx, xy, yx, yy), inverse = _relative_gradient(before, after)
    mean, half, cross, c, s = _stretch(xx, xy, yx, yy)
    z2 = (half * half + cross * cross) / mean**2
    if z2 > SERIES_LIMIT**2:
        z = np.sqrt(z2)
        value = np.arctanh(z) / z
        slope = (1 / (1 - z2) - value) / z2  # of atanh(z)/z, over z
    else:
        value, slope = 1 + z2 / 3, 2 / 3 + 4 * z2 / 5
    factor, by_mean, by_deviator = value / mean, -1 / (1 - z2) / mean**2, slope / mean**3
    determinant = 2 * (xx * yy - xy * yx)
    for k in range(4):
        i, j = k // 2, k % 2  # row and column of the gradient
        x, y = inverse[2 * j], inverse[2 * j + 1]
        dxx, dxy, dyx, dyy = (x, y, 0.0, 0.0) if i == 0 else (0.0, 0.0, x, y)
        angle = (c * (dyx - dxy) - s * (dxx + dyy)) / (2 * mean)
        dmean = (c * (dxx + dyy) + s * (dyx - dxy)) / 2
        dhalf = (c * (dxx - dyy) + s * (dyx + dxy)) / 2 + angle * cross
        dcross = (c * (dxy + dyx) + s * (dyy - dxx)) / 2 - angle * half
        volume = (yy * dxx + xx * dyy - xy * dyx - yx * dxy) / determinant
        dfactor = by_mean * dmean + by_deviator * (half * dhalf + cross * dcross)
        difference = factor * dhalf + dfactor * half
        derivatives[0, k] = volume + difference
        derivatives[1, k] = volume - difference
        derivatives[2, k] = 2 * (factor * dcross + dfactor * cross)
        derivatives[3, k] = angle


@inlined
def _integrate_interval(law, values, before, after, multipliers, carried, derivatives):
    """Integrate the constitutive law at one point between two displacement gradients.

    Arguments beyond `law` of `integrate_elements` and the `values` and gradients at the point are as of
    `integrate_path`. Returns success, the values after the increment, plastic work in the current volume [J/m3], work
    of deformation [J/m3 of fed mix], and cosine and sine of the rotation.
    """
    constants, line, finite = law
    valid, strain, volume, c, s = strain_increment(before, after, finite)
    converged, end, plastic, work = integrate_path(constants, line, values, strain, multipliers, carried, derivatives)
    xx, yy, xy = _rotate(end[0], end[1], end[3], c, s)
    rotated = (xx, yy, end[2], xy, end[4], end[5])
    return valid and converged, rotated, plastic, volume * work, (c, s)


@internal
def _rotate(xx, yy, xy, c, s):
    """Return xx, yy and xy of a tensor rotated by the angle of cosine c and sine s."""
    turn = 2 * c * s * xy
    return c * c * xx + s * s * yy - turn, s * s * xx + c * c * yy + turn, c * s * (xx - yy) + (c * c - s * s) * xy


@inlined
def _stress_derivatives(values, frame, path_derivatives, kinematics, derivatives):
    """Write the derivatives of the stress (xx, yy, xy) after an increment by the gradient after it, shape (3, 4).

    `path_derivatives`, shape (6, 3), are those by the strain in the unrotated frame as of `integrate_path`, and
    `kinematics`, shape (4, 4), as of `strain_derivatives`.
    """
    c, s = frame
    for j in range(4):
        xx, yy, xy, angle = 0.0, 0.0, 0.0, kinematics[3, j]
        for i in range(3):
            e = kinematics[i, j]
            xx += e * path_derivatives[0, i]
            yy += e * path_derivatives[1, i]
            xy += e * path_derivatives[3, i]
        xx, yy, xy = _rotate(xx, yy, xy, c, s)
        derivatives[0, j] = xx - 2 * values[3] * angle
        derivatives[1, j] = yy + 2 * values[3] * angle
        derivatives[2, j] = xy + (values[0] - values[1]) * angle


@compiled
def integrate_elements(
    law: tuple, mesh: tuple, displacements: tuple, before: tuple, after: tuple, guesses: tuple, results: tuple
) -> int:
    """Integrate an increment in all elements.

    Parameters
    ----------
    law : tuple
        `CapConstants`, True for a shear line or None, True for finite strain.
    mesh : tuple of ndarray
        Nodes (elements, 8), gradients of the shape functions (elements, 4, 8, 2) [1/m], areas of the points [m2].
    displacements : tuple of ndarray
        Displacements of the nodes before and after, shape (N, 2) [m].
    before, after : tuple of ndarray
        Stress (n, 4), density ratio, largest density ratio, plastic work and work (n,) of the points; `after` output.
    guesses : tuple of ndarray
        Initial guesses of the return mappings, shape (n, substeps), 0 for none, replaced by the solutions; and carried
        pressures of the points [Pa], shape (n,), or (0,) for none.
    results : tuple of ndarray
        Output: internal forces of the elements, shape (elements, 16) [N/m], and their derivative by the displacement,
        shape (elements, 16, 16) [N/m2], or (0, 16, 16) without derivative.

    Returns
    -------
    int
        First point where an element inverts or the return mapping does not converge, or -1.
    """
    forces, stiffness = results
    multipliers, carried = guesses
    nodes, shape_gradients, areas = mesh
    stress, density_ratio, max_density_ratio, plastic_work, work = before
    tangent = len(stiffness) > 0
    path_derivatives, kinematics = np.empty((6, 3 if tangent else 0)), np.empty((4, 4))
    derivatives, by_gradient, products = np.empty((3, 4)), np.empty((4, 4)), np.empty((4, 16))
    for element in range(len(forces)):
        forces[element] = 0.0
        if tangent:
            stiffness[element] = 0.0
        for point in range(4):
            i, shapes = 4 * element + point, shape_gradients[element, point]
            old = _gradient(displacements[0], nodes[element], shapes)
            new = _gradient(displacements[1], nodes[element], shapes)
            values = (stress[i, 0], stress[i, 1], stress[i, 2], stress[i, 3], density_ratio[i], max_density_ratio[i])
            good, values, dissipated, done, frame = _integrate_interval(
                law, values, old, new, multipliers[i], carried[i] if len(carried) else np.nan, path_derivatives
            )
            if not good:
                return i
            for j in range(4):
                after[0][i, j] = values[j]
            after[1][i], after[2][i] = values[4], values[5]
            after[3][i], after[4][i] = plastic_work[i] + dissipated, work[i] + done
            cofactors = (1 + new[3], -new[2], -new[1], 1 + new[0]) if law[2] else (1.0, 0.0, 0.0, 1.0)
            _add_forces(_piola_stress(values, cofactors), areas[i], shapes, forces[element])
            if tangent:
                strain_derivatives(old, new, law[2], kinematics)
                _stress_derivatives(values, frame, path_derivatives, kinematics, derivatives)
                _piola_derivatives(values, cofactors, law[2], derivatives, by_gradient)
                _add_stiffness(by_gradient, areas[i], shapes, products, stiffness[element])
    return -1


@internal
def _gradient(displacement, nodes, shapes):
    """Return the displacement gradient at one point."""
    xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0
    for a in range(8):
        x, y = displacement[nodes[a], 0], displacement[nodes[a], 1]
        xx += x * shapes[a, 0]
        xy += x * shapes[a, 1]
        yx += y * shapes[a, 0]
        yy += y * shapes[a, 1]
    return xx, xy, yx, yy


@internal
def _piola_stress(values, cofactors):
    """Return sigma cof F, (xx, xy, yx, yy), of cofactors (xx, xy, yx, yy)."""
    sxx, syy, sxy = values[0], values[1], values[3]
    cxx, cxy, cyx, cyy = cofactors
    return sxx * cxx + sxy * cyx, sxx * cxy + sxy * cyy, sxy * cxx + syy * cyx, sxy * cxy + syy * cyy


@inlined
def _piola_derivatives(values, cofactors, finite, derivatives, by_gradient):
    """Write the derivative of the Piola stress by the gradient after the increment, shape (4, 4)."""
    for k in range(4):
        change = (derivatives[0, k], derivatives[1, k], 0.0, derivatives[2, k])
        xx, xy, yx, yy = _piola_stress(change, cofactors)
        by_gradient[0, k], by_gradient[1, k], by_gradient[2, k], by_gradient[3, k] = xx, xy, yx, yy
    if finite:
        sxx, syy, sxy = values[0], values[1], values[3]
        by_gradient[0, 3] += sxx
        by_gradient[0, 1] -= sxy
        by_gradient[1, 2] -= sxx
        by_gradient[1, 0] += sxy
        by_gradient[2, 3] += sxy
        by_gradient[2, 1] -= syy
        by_gradient[3, 2] -= sxy
        by_gradient[3, 0] += syy


@inlined
def _add_forces(piola, area, shapes, forces):
    """Add the nodal forces of one point."""
    xx, xy, yx, yy = area * piola[0], area * piola[1], area * piola[2], area * piola[3]
    for a in range(8):
        forces[2 * a] += xx * shapes[a, 0] + xy * shapes[a, 1]
        forces[2 * a + 1] += yx * shapes[a, 0] + yy * shapes[a, 1]


@inlined
def _add_stiffness(by_gradient, area, shapes, products, stiffness):
    """Add the stiffness of one point; `products` is a buffer of shape (4, 16)."""
    for m in range(4):
        for a in range(8):
            x, y = area * shapes[a, 0], area * shapes[a, 1]
            products[m, 2 * a] = by_gradient[m, 0] * x + by_gradient[m, 1] * y
            products[m, 2 * a + 1] = by_gradient[m, 2] * x + by_gradient[m, 3] * y
    for a in range(8):
        x, y = shapes[a, 0], shapes[a, 1]
        for j in range(16):
            stiffness[2 * a, j] += x * products[0, j] + y * products[1, j]
            stiffness[2 * a + 1, j] += x * products[2, j] + y * products[3, j]


@compiled
def add_to_band(stiffness: Array, numbers: IntArray, width: int, band: Array) -> None:
    """Add element matrices to a band matrix in the layout of LAPACK's `gbtrf`.

    Parameters
    ----------
    stiffness : ndarray, shape (elements, n, n)
        Element matrices.
    numbers : ndarray of int, shape (elements, n)
        Equation of each row and column, -1 for none.
    width : int
        Half-width of the band.
    band : ndarray, shape (equations, 3 width + 1)
        Transposed band matrix, modified in place.
    """
    for element in range(len(stiffness)):
        for i in range(numbers.shape[1]):
            row = numbers[element, i]
            if row < 0:
                continue
            for j in range(numbers.shape[1]):
                column = numbers[element, j]
                if column >= 0:
                    band[column, 2 * width + row - column] += stiffness[element, i, j]


@compiled
def multiply_elements(stiffness: Array, numbers: IntArray, vector: Array) -> Array:
    """Multiply the sum of element matrices by a vector, both as of `add_to_band`."""
    product = np.zeros_like(vector)
    for element in range(len(stiffness)):
        for i in range(numbers.shape[1]):
            row = numbers[element, i]
            if row < 0:
                continue
            total = 0.0
            for j in range(numbers.shape[1]):
                column = numbers[element, j]
                if column >= 0:
                    total += stiffness[element, i, j] * vector[column]
            product[row] += total
    return product
