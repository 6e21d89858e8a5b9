"""What mix becomes as it streams under the roller in steady motion: every row of points from the front to the rear.

    state_j = step(state_(j+1), strain from F_(j+1) to F_j)

Point j + 1 lies upstream of j in the same row of the fed layer; far in front the mix is as fed and F = 1. So the states
of a layer follow from its displacement alone, in one sweep, and so do their derivatives, by what each point is told:
the state that enters it and the gradients at both ends of the path. The path is straight in the logarithmic strain of
`deformation`, and the mix follows it in small steps.
"""

from dataclasses import dataclass

import numpy as np

from compact.material import cap_plasticity
from compact.numerics.jit import compiled

NUMBERS = 6  # that a point must know: stress (xx, yy, zz, xy), density ratio, the one that pc remembers
TOLD = 14  # what the next point follows from: these six, the gradient before, the gradient after
NEARBY = 1e-8  # strain, density ratio and stress over the modulus by which differences are taken
NEARLY_ROUND = 1e-4  # half the logarithm of the stretches' ratio, below which atanh(z)/z is 1 + z^2/3 to rounding

SLICE = 20_000  # steps of points in one compiled call: some 20 ms, half a second where each takes all attempts


@dataclass(frozen=True, eq=False)
class StreamlineState:
    """Of rows of points, x ascending: what they are, shape (rows, n, 6), and what they have taken up [J/m3].

    numbers : stress (xx, yy, zz, xy) [Pa], density ratio, the one that pc remembers
    plastic_work : in the volume of its time;  work : int J sigma : d strain of the mix as it was fed
    """

    numbers: np.ndarray
    plastic_work: np.ndarray
    work: np.ndarray


@dataclass(frozen=True, eq=False)
class StreamlineIntegrator:
    """Mix that enters rows of points from the right.

    law : Compaction;  fed : cap.State, one point a row;  finite : strains are;  substeps : of the path between points
    """

    law: object
    fed: cap_plasticity.MaterialPoint
    rate_factor: float
    finite: bool
    substeps: int

    def along(self, gradients):
        """The `StreamlineState` under displacement gradients (xx, xy, yx, yy), shape (rows, n, 4).

        Raises RuntimeError where the layer folds over.
        """
        rows, columns = gradients.shape[:2]
        numbers, works = np.empty((rows, columns, NUMBERS)), np.empty((rows, columns, 2))
        given = *self._constants, self.fed.plastic_work, gradients, numbers, works
        for first, end in _slices(rows, columns * self.substeps):
            failed = _sweep(first, end, *given)
            if failed < 0:
                continue
            row, column = divmod(failed, columns)
            raise RuntimeError(
                f"the mix does not follow at point {column} of row {row} of points: the layer folds over"
            )
        return StreamlineState(numbers, works[..., 0], works[..., 1])

    def derivatives(self, gradients, flow):
        """d numbers by what each point of a `StreamlineState` was told, shape (rows, n, 6, 14), by differences."""
        slopes = np.empty((*gradients.shape[:2], NUMBERS, TOLD))
        nearby = np.full(TOLD, NEARBY)
        nearby[:4] *= self.law.unloading_modulus
        given = *self._constants, gradients, flow.numbers, nearby, slopes
        rows, columns = gradients.shape[:2]
        for first, end in _slices(rows, TOLD * columns * self.substeps):
            _slopes(first, end, *given)
        return slopes

    @property
    def _constants(self):
        enters = np.column_stack([self.fed.stress, self.fed.density_ratio, self.fed.max_density_ratio])
        return cap_plasticity.cap_constants(self.law, self.rate_factor), self.finite, self.substeps, enters


def changes(slopes, gradients):
    """Changes of the numbers with those of the gradients, shape (rows, n, 6), by the `derivatives`."""
    numbers, gradients = np.empty((*gradients.shape[:2], NUMBERS)), np.ascontiguousarray(gradients)
    for first, end in _slices(*gradients.shape[:2]):
        _pass_on(first, end, slopes, gradients, numbers)
    return numbers


def _slices(rows, steps):
    """(first, end) of blocks of rows, each of so many steps of points, for one compiled call each: an interrupt gets in
    between two of them."""
    most = max(SLICE // max(steps, 1), 1)
    return [(first, min(first + most, rows)) for first in range(0, rows, most)]


@compiled
def _sweep(first, end, law, finite, substeps, enters, plastic_work, gradients, numbers, works):
    """Rows from `first` to before `end`, each from its right end; the first point that failed, or -1."""
    told, columns = np.zeros(TOLD), gradients.shape[1]
    for row in range(first, end):
        dissipated, work = plastic_work[row], 0.0
        for j in range(columns - 1, -1, -1):
            _tell(told, enters[row], gradients[row], numbers[row], j)
            good, more, done = _next(law, told, finite, substeps, numbers[row, j])
            if not good:
                return row * columns + j
            dissipated, work = dissipated + more, work + done
            works[row, j, 0], works[row, j, 1] = dissipated, work
    return -1


@compiled
def _tell(told, enters, gradients, numbers, j):
    """What point j of a row follows from."""
    if j + 1 < len(gradients):
        told[:NUMBERS] = numbers[j + 1]
        told[NUMBERS:10] = gradients[j + 1]
    else:
        told[:NUMBERS] = enters
        told[NUMBERS:10] = 0.0
    told[10:] = gradients[j]


@compiled
def _slopes(first, end, law, finite, substeps, enters, gradients, numbers, nearby, slopes):
    """Differences of every point by all that it was told."""
    told, moved = np.zeros(TOLD), np.empty(NUMBERS)
    for row in range(first, end):
        for j in range(gradients.shape[1]):
            _tell(told, enters[row], gradients[row], numbers[row], j)
            for k in range(TOLD):
                held = told[k]
                told[k] = held + nearby[k]
                _next(law, told, finite, substeps, moved)
                for i in range(NUMBERS):
                    slopes[row, j, i, k] = (moved[i] - numbers[row, j, i]) / nearby[k]
                told[k] = held


@compiled
def _pass_on(first, end, slopes, gradients, numbers):
    """The chain rule along each row from `first` to before `end`."""
    told = np.zeros(TOLD)
    for row in range(first, end):
        for j in range(gradients.shape[1] - 1, -1, -1):
            told[:10] = 0.0
            if j + 1 < gradients.shape[1]:
                told[:NUMBERS] = numbers[row, j + 1]
                told[NUMBERS:10] = gradients[row, j + 1]
            told[10:] = gradients[row, j]
            for i in range(NUMBERS):
                total = 0.0
                for k in range(TOLD):
                    total += slopes[row, j, i, k] * told[k]
                numbers[row, j, i] = total


@compiled
def _next(law, told, finite, substeps, after):
    """Writes the numbers after the path from what is told; whether all went well, plastic work, and work of the fed."""
    good, strain, volume, cosine, sine = _strained(told[6:10], told[10:], finite)
    exx, eyy, gamma = strain[0] / substeps, strain[1] / substeps, strain[2] / substeps
    now = (told[0], told[1], told[2], told[3], told[4], told[5])
    plastic_work, work = 0.0, 0.0
    for _ in range(substeps):
        before = now
        closed, now, dissipated, _, _ = cap_plasticity.integrate_point(law, before, exx, eyy, gamma)
        good = good and closed
        plastic_work += dissipated
        work += ((before[0] + now[0]) * exx + (before[1] + now[1]) * eyy + (before[3] + now[3]) * gamma) / 2
    xx, yy, xy = now[0], now[1], now[3]
    across = 2 * cosine * sine * xy
    after[0] = cosine * cosine * xx + sine * sine * yy - across
    after[1] = sine * sine * xx + cosine * cosine * yy + across
    after[2] = now[2]
    after[3] = cosine * sine * (xx - yy) + (cosine * cosine - sine * sine) * xy
    after[4], after[5] = now[4], now[5]
    return good, plastic_work, volume * work


@compiled
def _strained(before, after, finite):
    """`deformation.Finite` or `Small` of one point: whether it is not folded, strain, J midway, cosine, sine."""
    if not finite:
        strain = (after[0] - before[0], after[3] - before[3], after[1] + after[2] - before[1] - before[2])
        return True, strain, 1.0, 1.0, 0.0
    axx, axy, ayx, ayy = 1 + after[0], after[1], after[2], 1 + after[3]
    bxx, bxy, byx, byy = 1 + before[0], before[1], before[2], 1 + before[3]
    volume, volume_before = axx * ayy - axy * ayx, bxx * byy - bxy * byx
    xx, xy = (axx * byy - axy * byx) / volume_before, (axy * bxx - axx * bxy) / volume_before
    yx, yy = (ayx * byy - ayy * byx) / volume_before, (ayy * bxx - ayx * bxy) / volume_before
    size = np.hypot(xx + yy, yx - xy)
    c, s = (xx + yy) / size, (yx - xy) / size
    mean, half, cross = size / 2, (c * (xx - yy) + s * (yx + xy)) / 2, (c * (xy + yx) + s * (yy - xx)) / 2
    ratio = np.hypot(half, cross) / mean
    rise = (np.arctanh(ratio) / ratio if ratio > NEARLY_ROUND else 1 + ratio * ratio / 3) / mean
    half_volume = np.log(volume / volume_before) / 2
    strain = (half_volume + rise * half, half_volume - rise * half, 2 * rise * cross)
    return volume > 0 and volume_before > 0, strain, np.sqrt(volume * volume_before), c, s
