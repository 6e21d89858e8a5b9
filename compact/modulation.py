"""How the resistance follows a speed that changes slowly, at first order in the acceleration.

    F(v, a) ~ F_ss(v) + a M(v)

The surface of a viscoelastic layer still remembers a lower speed under a roller that gathers speed: M is an added mass,
of no matter but of memory. At low speeds it is negative, a pure lag; at high ones it fades.

    v -> 0     M -> -t dF_ss/dv,  t = sum share time^2/sum share time
    v -> inf   M ~ 1/v^3

The lag is that of gaps measured vertically; normal to the circle on the deformed surface it is longer by about the
indentation over the radius. F_ss is odd in v, M even. What the roller prescribes, be it indentation, load or peak
pressure, is kept at every instant of the motion as F_ss(v) keeps it over v. Inertia of layer and roller is not in it.

Layers of columns, engine "column", remember the way, not the time: at a given indentation the density under the roller
is a matter of geometry and the yield limit one of the speed now, so that M = 0 exactly. The same holds for the engine
"compaction" where the mix knows no rate.
"""

from dataclasses import dataclass

import numpy as np

from compact.refuse import refuse_nonfinite

SLOW = 0.1  # unsteadiness at which the first order leaves out 0.4 % of F on a Winkler foundation, or less


@dataclass(frozen=True)
class Modulation:
    """Resistance of one roller near a steady speed, per unit roller length.

    speed : v [m/s]
    resistance : F_ss [N/m]
    slope : dF_ss/dv [N s/m2]
    added_mass : M [N s2/m2]
    error : estimated, of `added_mass` [N s2/m2], or None where the engine cannot tell; not relative, as M passes zero
    time : tau, the longest relaxation time [s], 0 of an elastic layer
    """

    speed: float
    resistance: float
    slope: float
    added_mass: float
    error: float | None
    time: float

    def unsteadiness(self, acceleration):
        """|a| tau/|v| [-] at accelerations a [m/s2]: use F_ss + a M below `SLOW`; at 1 and above it is void.

        A contact that is short, 2b/v < tau with b its half-width, forgets sooner: then |a| 2b/v^2 << 1 is enough.

        >>> found = Modulation(0.5, 100.0, 20.0, -3.0, error=0.0, time=0.1)
        >>> f"{found.unsteadiness(-0.25):.2f}"
        '0.05'
        """
        refuse_nonfinite(acceleration=acceleration)
        return np.abs(acceleration) * self.time / abs(self.speed)
