"""What pressed mix remembers of a roller that turns back over it, by columns, for an equation of motion.

    F(s) = F_turn g(s/l) - F_again (1 - exp(-s/r)),    g(z) = 1 - 2 z/3 for z <= 1,  1/(3 z^2) beyond

s is the distance from the turn, F the resistance in the direction of before. At the turn the mix still pushes the
roller as it did; going back lets the front of the contact, pressed by p all along its length a, rise by s x/R at x. It
is elastic, with the modulus M of a layer h high, so that the pressure falls as p - M s x/(h R) until nothing is left,

    F_turn g = int_0^a max(p - M s x/(h R), 0) x/R dx,    l = p h R/(M a),

a small part of the contact. What the way back itself asks comes with the length r. Both lengths are fitted to one
travel, and the error is that of the fit. Time does not enter: mix with the rate effect is known at its own speed only.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from compact.refuse import refuse_negative, refuse_nonpositive

FIRST = 0.05, 1.0  # guesses of l and r, of the contact in front
FEWEST = 10  # steps of a way back that tells two lengths


@dataclass(frozen=True)
class PressedMemory:
    """Resistance after a turn over pressed mix.

    turning : F_turn, of the roller where it turned [N/m];  again : F_again, of the way back, far from the turn [N/m]
    release, recovery : the lengths l and r [m];  error : largest miss of the fit over F_turn
    """

    turning: float
    again: float
    release: float
    recovery: float
    error: float = 0.0

    def __post_init__(self):
        refuse_nonpositive(turning=self.turning, release=self.release, recovery=self.recovery)
        refuse_negative(again=self.again)

    def resistance(self, distance):
        """F(s) [N/m] at a distance s >= 0 from the turn [m], + in the direction of before the turn."""
        refuse_negative(distance=distance)
        distance = np.asarray(distance, dtype=float)
        left = self.turning * released(distance / self.release)
        return left + self.again * np.expm1(-distance / self.recovery)


def released(z):
    """g(z), the share of the resistance that is left after z release lengths on the way back."""
    z = np.asarray(z, dtype=float)
    return np.where(z <= 1, 1 - 2 * z / 3, 1 / (3 * np.maximum(z, 1.0) ** 2))


def fitted(travelled):
    """The `PressedMemory` of the first turn of a `CompactionTravelled`, by least squares over the way back.

    F_again is the mean over the second half of that way, which should be some contacts long; the last contact length of
    it is left out, where a roller from rest comes back to the pit it began in.
    """
    there, back = (travelled.stroke == number for number in (1, 2))
    if not back.any():
        raise ValueError(f"a `travelled` roller must have turned back, got {int(travelled.stroke.max())} stroke")
    if travelled.lowest[back][0] != travelled.lowest[there][-1]:
        raise ValueError("a `travelled` roller must go back over what it pressed, got mix fed at its turn")
    sign = np.sign(travelled.position[there][-1] - travelled.position[there][0])
    turning = float(sign * travelled.resistance[there][-1])
    contact = max(travelled.leading[there][-1], -travelled.trailing[there][-1])
    distance = np.abs(travelled.position[back] - travelled.position[there][-1])
    counts = distance <= distance[-1] - contact
    distance, forces = distance[counts], sign * travelled.resistance[back][counts]
    if len(distance) < FEWEST:
        raise ValueError(
            f"a `travelled` roller must go back farther than its contact, got {len(distance)} steps beyond"
        )
    again = max(-float(np.mean(forces[distance > distance[-1] / 2])), 0.0)

    def missed(logs):
        return (PressedMemory(turning, again, *np.exp(logs)).resistance(distance) - forces) / turning

    fit = least_squares(missed, np.log(np.multiply(FIRST, contact)))
    return PressedMemory(turning, again, *map(float, np.exp(fit.x)), error=float(np.abs(fit.fun).max()))
