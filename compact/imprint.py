"""What a roller leaves in a foundation of columns and meets there again, in compiled code, step by step.

    p = w + sum s_i (w - z_i),    tau_i dz_i/dt = w - z_i,    w = (b^2 - x^2)/2R where p > 0, else p = 0
    m = sum over columns of p x dX/R,    x = X - position of the roller

Over a step each w is linear in time, so that a step is as long as the way allows, however short a relaxation time. The
columns stand at even places X; `memory.Columns` makes them.
"""

from typing import NamedTuple

import numpy as np

from compact.ringing import compiling

AT_ONCE = 1e-300  # of a relaxation time: the step in which nothing relaxes
SMALL = 1e-8  # step over relaxation time, below which a difference would lose digits

compiled = compiling(__file__)


class Imprint(NamedTuple):
    """Columns on radius R, half-length b [m] of the contact, shares s and times tau [s] of the branches.

    first, spacing : of the places [m];  w : shape (n,), z : shape (branches, n) [m]
    """

    radius: float
    half_length: float
    shares: np.ndarray
    times: np.ndarray
    first: float
    spacing: float
    w: np.ndarray
    z: np.ndarray


def copied(imprint):
    """The same columns, to go another way."""
    return imprint._replace(w=imprint.w.copy(), z=imprint.z.copy())


@compiled
def pressed(imprint, position, step, keep):
    """m [m2] of a roller that is at a position [m] after a step [s]; keep : whether the columns go along.

    Only columns under the roller press, so that a trial looks at no others.
    """
    radius, half_length, shares, times, first, spacing, w, z = imprint
    y = np.maximum(step / times, AT_ONCE)
    new = np.where(y > SMALL, 1 + np.expm1(-y) / np.maximum(y, SMALL), y / 2)
    decay, older = np.exp(-y), -np.expm1(-y) - new
    stiff, found = 1 + np.sum(shares * (1 - new)), 0.0
    begin, end = 0, len(w)
    if not keep:
        begin = min(max(int((position - half_length - first) / spacing) - 1, 0), end)
        end = min(max(int((position + half_length - first) / spacing) + 2, 0), end)
    for j in range(begin, end):
        x = first + j * spacing - position
        held = 0.0
        for k in range(len(shares)):
            held += shares[k] * (decay[k] * z[k, j] + older[k] * w[j])
        depth = max((half_length**2 - x**2) / (2 * radius), held / stiff)
        found += (stiff * depth - held) * x
        if keep:
            for k in range(len(shares)):
                z[k, j] = decay[k] * z[k, j] + older[k] * w[j] + new[k] * depth
            w[j] = depth
    return found * spacing / radius


@compiled
def rolled(imprint, time, position):
    """m [m2] at instants of a motion, shape (n,); the columns go along."""
    found = np.empty(len(time))
    for i in range(len(time)):
        found[i] = pressed(imprint, position[i], time[i] - time[max(i - 1, 0)], True)
    return found
