"""Laws made for the machine of a scene: what its table [motion.optimise] asks for, as limits and laws."""

import numpy as np

from compact.motion import CamLimits, InfeasibleError, Limits, optimise

REACHES, FARTHER = 8, 1.3  # times that the resistance is carried on, to a speed so many times as large
NEAR = 1 - 1e-6  # of the bound on the velocity: a law there is held back by it


def limits(scene, fastest):
    """`Limits` of a scene with [motion.optimise]; `fastest` [m/s] is what the resistance is known up to, or inf."""
    table, motion = scene.motion.optimise, scene.motion
    velocity = min(fastest, table.velocity or np.inf)
    shares = {} if table.steady_tolerance is None else {"run_up": motion.run_up, "run_down": motion.run_down}
    return Limits(
        velocity=velocity if np.isfinite(velocity) else None,
        acceleration=table.acceleration,
        jerk=table.jerk,
        snap=table.snap,
        steady_tolerance=table.steady_tolerance or 0.0,
        smoothness=table.smoothness,
        turn="dwell" if motion.dwell else "reversal",
        cam=_cam(scene),
        **shares,
    )


def _cam(scene):
    table = scene.motion.optimise
    asked = table.pressure_angle, table.radius_of_curvature, table.profile_radius
    if asked == (None, None, None):
        return None
    angle, flat, profile = asked
    return CamLimits(scene.cam.breadth, angle, flat, scene.motion.dwell, profile, scene.cam.roller_follower_radius)


def law(scene, objective, study):
    """The law that asks least of one objective, an `OptimalMotion`; over a spread of the mix the one of least regret.

    study : a `Study` of the scene, with its `limits` and `oppositions`; its resistance is carried on to faster motion
        as long as the law wants to go as fast as that is known, and the scene lets it.

    Raises RuntimeError if the law reaches the largest velocity each time, InfeasibleError if no law keeps the limits.
    """
    motion, method = scene.motion, scene.motion.optimise.method
    for _ in range(REACHES):
        limits, pushes = study.limits, study.oppositions
        task = objective, motion.stroke, motion.duration, study.cart.mass, pushes, limits
        bounded = limits.velocity in (None, motion.optimise.velocity)
        try:
            made = optimise(*task, regret=len(pushes) > 1, method=method)
        except InfeasibleError as error:
            if bounded or "velocity" not in {conflict.name for conflict in error.conflicts}:
                raise
        else:
            if bounded or made.peaks().velocity < NEAR * limits.velocity:
                return made
        study.reach(FARTHER * limits.velocity)
    raise RuntimeError(
        f"the law of least {objective.replace('_', ' ')} wants to go as fast as {limits.velocity:.3g} m/s and faster; "
        "bound its `velocity` or `acceleration` in [motion.optimise]"
    )
