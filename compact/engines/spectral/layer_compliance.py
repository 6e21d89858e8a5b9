"""The surface of a layer of plies on a rigid base, in Fourier space.

Under tractions that vary as exp(ikx) each ply, plane strain and K = 3 - 4 nu, is crossed by four waves. With y counted
in 1/k, u_x = i U, s_xy = i k mu T and s_yy = k mu S, two of them die out downwards,

    (U, V, T, S) = (1, 1, 2, 2) e^y  and  (y, y - K, 2y + 1 - K, 2y - 1 - K) e^y,

and two upwards, the mirror images of these. What the lower end of a ply throws back of the former is a 2 x 2 matrix,
the echo: that of the base follows from what the base holds, each ply carries it to its top, where it is fainter by
exp(-2 k thickness) for the way down and up, and every interface passes it on to the next ply. No wave ever grows on its
way, so that neither short waves nor stiff plies cost digits.
"""

import numpy as np

LONGEST = 1e4  # wave length over 2 pi heights: beyond it sinking falls with k exactly, and digits would be lost


def surface_defects(wave_number, layer, poisson):
    """L - 1 and M - b [-] at wave numbers k [1/m] >= 0, shape (n,) each.

    L and M are the sinking under a pressure and under a shear traction, over that of the half-plane of the top ply
    under a pressure; b = (1 - 2 nu)/(2 - 2 nu) is M of the half-plane. One bonded ply has

        L = (2K sinh 2z - 4z)/(2K cosh 2z + 4z^2 + 1 + K^2),  z = k H;  one that slips  L = (cosh 2z - 1)/(sinh 2z + 2z)

    References
    ----------
    K. L. Johnson, Contact Mechanics, CUP 1985, section 5.8, for one ply.

    >>> from compact.rolling_contact import Layer, Ply
    >>> one, two = Layer(1.0), Layer(1.0, plies=(Ply(0.8, 20.0), Ply(0.2, 1.0)))
    >>> [f"{surface_defects(np.array([1.0]), layer, 0.3)[0][0]:.6f}" for layer in (one, two)]
    ['-0.584248', '-0.901422']
    """
    k = np.maximum(wave_number, 1 / (LONGEST * layer.height))
    down, up = _waves(poisson)
    echo = _echo_at_the_surface(k, layer, down, up)
    half_plane = down[:2] @ np.linalg.inv(down[2:])
    more = (up[:2] - half_plane @ up[2:]) @ echo @ np.linalg.inv(down[2:] + up[2:] @ echo)
    normal, shear = more[..., 1, 1] / (1 - poisson), -more[..., 1, 0] / (1 - poisson)
    return normal + (1 + normal) * (wave_number / k - 1), shear


def _waves(poisson):
    """(U, V, T, S) at y = 0 of the waves that die out downwards, and of those upwards: shape (4, 2) each."""
    K = 3 - 4 * poisson
    down = np.array([[1, 0], [1, -K], [2, 1 - K], [2, -1 - K]])
    return down, down * np.array([1, -1, -1, 1])[:, None]


def _echo_at_the_surface(k, layer, down, up):
    """Waves sent up by all that lies below the surface over those sent down, shape (n, 2, 2)."""
    held = [0, 1] if layer.base == "bonded" else [1, 2]
    echo, below = -np.linalg.solve(up[held], down[held]), None
    for ply in layer.stack:
        if below is not None:
            same = np.array([1, 1, below / ply.stiffness, below / ply.stiffness])  # displacement and stress
            waves = np.linalg.solve(np.hstack([down, up]), same[:, None] * (down + up @ echo))
            echo = waves[..., 2:, :] @ np.linalg.inv(waves[..., :2, :])
        z = (k * ply.thickness)[..., None, None]
        passed = np.exp(-z) * (np.eye(2) - z * np.array([[0, 1], [0, 0]]))
        echo, below = passed @ echo @ passed, ply.stiffness
    return echo
