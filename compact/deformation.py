"""From displacements to strain increments, small or finite, and what a stress becomes on the way.

Finite: the deformation gradients F before and after an increment give dF = F_after F_before^-1 = R U. Its strain is
ln U, taken in the frame of the mix before the increment; the Cauchy stress found there turns with it,

    sigma = R sigma_turned R',    force on a node = int J sigma grad N dV,    J = det F_after.

Small: the strain is the symmetric gradient of the displacement increment, nothing turns and J = 1.

Gradients have the components (xx, xy, yx, yy), g_ij = du_i/dx_j, along the second axis; all is batched over n points.
"""

from dataclasses import dataclass

import numpy as np

UNITY = np.array([1.0, 0.0, 0.0, 1.0])
NEARLY_ROUND = 1e-4  # half the logarithm of the stretches' ratio; below it atanh(z)/z is 1 + z^2/3 to rounding
TO_STRAIN = np.array([[1.0, 0, 0, 0], [0, 0, 0, 1.0], [0, 1.0, 1.0, 0]])  # (xx, yy, 2 xy) of a gradient
FROM_STRESS = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0], [0, 1.0, 0]])  # a tensor of (xx, yy, xy)


@dataclass(frozen=True, eq=False)
class Small:
    """Increment of linear kinematics; `strain` (xx, yy, 2 xy), shape (n, 3)."""

    strain: np.ndarray

    @classmethod
    def between(cls, before, after):
        """The increment between two displacement gradients, shape (n, 4)."""
        return cls((after - before) @ TO_STRAIN.T)

    @property
    def volume(self):
        """Volume over that of the reference, J."""
        return np.ones(len(self.strain))

    @property
    def volume_midway(self):
        """The same in the middle of the increment."""
        return self.volume

    @property
    def pull_back(self):
        """dX/dx, by which gradients over the reference become spatial, shape (n, 2, 2)."""
        return np.broadcast_to(np.eye(2), (len(self.strain), 2, 2))

    def turned(self, stress):
        """The stress (xx, yy, zz, xy) in the axes of the layer."""
        return stress

    def moduli(self, stress, tangent):
        """d(force density) by the spatial gradient of a change of the displacement, shape (n, 4, 4)."""
        return FROM_STRESS @ tangent @ TO_STRAIN


@dataclass(frozen=True, eq=False)
class Finite:
    """Increment of finite kinematics; `strain` ln U (xx, yy, 2 xy), shape (n, 3).

    gradient : F after it, shape (n, 4);  cosine, sine : of R;  stretch : of U, (mean, half difference, xy)
    """

    strain: np.ndarray
    gradient: np.ndarray
    cosine: np.ndarray
    sine: np.ndarray
    stretch: np.ndarray

    @classmethod
    def between(cls, before, after):
        """The increment between two displacement gradients, shape (n, 4), in closed form.

        R turns by the angle of (dF_xx + dF_yy, dF_yx - dF_xy); with m, d the spherical and deviatoric part of
        U = R' dF, ln U = ln(det U)/2 + atanh(|d|/m)/|d| d.
        """
        F = UNITY + after
        xx, xy, yx, yy = (_matrix(F) @ _inverse(_matrix(UNITY + before))).reshape(-1, 4).T
        size = np.hypot(xx + yy, yx - xy)
        c, s = (xx + yy) / size, (yx - xy) / size
        stretch = np.array([size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2])
        ratio = np.hypot(*stretch[1:]) / stretch[0]
        safe = np.maximum(ratio, NEARLY_ROUND)
        rise = np.where(ratio > NEARLY_ROUND, np.arctanh(safe) / safe, 1 + ratio**2 / 3) / stretch[0]
        half_volume = np.log(xx * yy - xy * yx) / 2
        strain = [half_volume + rise * stretch[1], half_volume - rise * stretch[1], 2 * rise * stretch[2]]
        return cls(np.array(strain).T, F, c, s, stretch)

    @property
    def volume(self):
        """Volume over that of the reference, J."""
        F = self.gradient
        return F[:, 0] * F[:, 3] - F[:, 1] * F[:, 2]

    @property
    def volume_midway(self):
        """The same in the middle of the increment."""
        return self.volume * np.exp(-(self.strain[:, 0] + self.strain[:, 1]) / 2)

    @property
    def pull_back(self):
        """dX/dx, by which gradients over the reference become spatial, shape (n, 2, 2)."""
        return _inverse(_matrix(self.gradient))

    def turned(self, stress):
        """The stress (xx, yy, zz, xy) in the axes of the layer."""
        xx, yy, zz, xy = stress.T
        c, s = self.cosine, self.sine
        across = 2 * c * s * xy
        return np.array(
            [
                c * c * xx + s * s * yy - across,
                s * s * xx + c * c * yy + across,
                zz,
                c * s * (xx - yy) + (c * c - s * s) * xy,
            ]
        ).T

    def moduli(self, stress, tangent):
        """d(force density) by the spatial gradient l of a change of the displacement, shape (n, 4, 4).

            d(J sigma grad N)/J = [tr(l) sigma + d sigma - sigma l'] grad N

        seen in the frame before the turn, where `stress` and `tangent` are given. There d ln U is the symmetric part of
        l but for squares of the strain increment, and R spins with the skew part less (U/m) times the shear of l.
        """
        n = len(stress)
        sxx, syy, sxy = stress[:, 0], stress[:, 1], stress[:, 3]
        sigma = np.array([sxx, sxy, sxy, syy]).T
        A = FROM_STRESS @ tangent @ TO_STRAIN + sigma[:, :, None] * UNITY
        a, b = self.stretch[1:] / self.stretch[0]
        spin = np.array([b / 2, (1 - a) / 2, -(1 + a) / 2, -b / 2]).T
        A += np.array([2 * sxy, syy - sxx, syy - sxx, -2 * sxy]).T[:, :, None] * spin[:, None, :]
        for row, column, part in (
            (0, 0, sxx), (0, 1, sxy), (1, 2, sxx), (1, 3, sxy), (2, 0, sxy), (2, 1, syy), (3, 2, sxy), (3, 3, syy),
        ):  # fmt: skip
            A[:, row, column] -= part
        R = np.array([self.cosine, -self.sine, self.sine, self.cosine]).T.reshape(n, 2, 2)
        turn = np.einsum("nij,nkl->nikjl", R, R).reshape(n, 4, 4)
        return turn @ A @ turn.transpose(0, 2, 1)


def _matrix(gradient):
    return gradient.reshape(-1, 2, 2)


def _inverse(matrix):
    (a, b), (c, d) = matrix.transpose(1, 2, 0)
    return np.array([[d, -b], [-c, a]]).transpose(2, 0, 1) / (a * d - b * c)[:, None, None]
