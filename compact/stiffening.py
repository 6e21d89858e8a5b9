"""A cold start of steady rolling: the balance of a layer so soft that it hardly yields, stiffened to the one asked for.

    R(u, share E_u) = 0,    share from SOFTEST yield pressures over E_u to 1

A soft layer under the roller is found from rest, like any contact. As its modulus of unloading rises, the mix keeps
more of what it was pressed to, and the bow wave grows to its height; the strain that is not elastic changes ever less.
Each balance is foreseen along the line through the last two, over the logarithm of the share. Nothing is marched, and
no wave must fill.
"""

from dataclasses import replace

import numpy as np

from compact.steady import Steady
from compact.turning import STICKING, TurningFace

SOFTEST = 13.0  # yield pressures of the fed mix
SOFTER = 4  # times half as soft, where that is not found from rest
FIRST = 1.5  # ratio of the first two shares
SHORTEST = 5e-3  # of the logarithm of the share, a step below which it gives up
QUICK, SLOW = 8, 14  # iterations within which a step may grow, and beyond which it shrinks
ROUGH = 3e-3  # residual on the way, and where it ends before the last balance
SHARPER = 0.85  # power of the share by which slip that is taken for sticking gets less


def stiffened(march_of, lowest):
    """A `March` that is steady with the lowest generatrix at a height [m], found at once.

    march_of : gives a march that has not begun, of mix with a share of its unloading modulus

    Raises RuntimeError with the share reached.
    """
    share, there, step = _softest(march_of(1.0).frame), None, np.log(FIRST)
    here = _from_rest(march_of, share, lowest)
    share = here[1]
    while share < 1:
        ahead = min(share * np.exp(step), 1.0)
        march = march_of(ahead)
        try:
            _settled(march, _foreseen(here, there, ahead), lowest, ahead)
        except RuntimeError as error:
            step /= 2
            if step < SHORTEST:
                raise RuntimeError(f"found up to {share:.3g} of the unloading modulus, then: {error}") from error
            continue
        iterations = march.steps[-1].iterations
        step *= 1.4 if iterations < QUICK else 1 / 1.3 if iterations > SLOW else 1.0
        here, there, share = (march, ahead), here, ahead
    march = here[0]
    march.settled(
        Steady(march.frame, march.face.at(lowest), progress=march.progress).balanced(march.condition.displacement),
        lowest,
    )
    return march


def _from_rest(march_of, share, lowest):
    """The first march and its share, softer where it must be."""
    for _ in range(SOFTER):
        try:
            return _settled(march_of(share), None, lowest, share)
        except RuntimeError as error:
            reason, share = error, share / 2
    raise RuntimeError(f"not found even with {2 * share:.2g} of the unloading modulus: {reason}")


def _softest(frame):
    law = frame.solid.law
    yields = law.yield_pressure(float(frame.fed.state.hardened.max())) * frame.solid.rate_factor
    return min(SOFTEST * float(yields) / law.unloading_modulus, 1.0)


def _foreseen(here, there, share):
    """Displacement and pressure on the line through the last two, and shear and creep of the last."""
    (last, at), push = here, here[0].push
    displacement, pressure = last.condition.displacement, push.pressure
    if there is not None:
        before, behind = there
        way = np.log(share / at) / np.log(at / behind)
        displacement = displacement + way * (displacement - before.condition.displacement)
        pressure = np.maximum(pressure + way * (pressure - before.push.pressure), 0.0)
    return displacement, pressure, push.shear, push.creep


def _settled(march, foreseen, lowest, share):
    """The march in its steady balance, and the share."""
    if foreseen is None:
        foreseen = _without_grip(march, lowest)
    displacement, *carried = foreseen
    march.face = march.face.carrying(*carried)
    face = march.face.at(lowest)
    if isinstance(face, TurningFace):
        face = replace(face, sticking=STICKING * share**-SHARPER)
    march.settled(Steady(march.frame, face, progress=march.progress).balanced(displacement, residual=ROUGH), lowest)
    return march, share


def _without_grip(march, lowest):
    """The balance from rest, without the shear of a roller that turns."""
    still = march.condition.displacement
    if not isinstance(march.face, TurningFace):
        return still, march.face.carried, None, None
    face = replace(march.face, grip=0.0, pull=0.0).at(lowest)
    found = Steady(march.frame, face, progress=march.progress).balanced(still, residual=ROUGH)
    return found.after.displacement, found.push.pressure, found.push.shear, 0.0
