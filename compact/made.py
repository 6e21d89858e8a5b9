"""Laws made for the machine of a scene: what its table [motion.optimise] asks for, as limits and laws."""

from compact.motion import CamLimits, Limits, optimise


def limits(scene, fastest):
    """`Limits` of a scene with [motion.optimise]; `fastest` [m/s] is what the resistance is known up to."""
    table, motion = scene.motion.optimise, scene.motion
    shares = {} if table.steady_tolerance is None else {"run_up": motion.run_up, "run_down": motion.run_down}
    return Limits(
        velocity=min(fastest, table.velocity or fastest),
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


def law(scene, objective, pushes, limits):
    """The law that asks least of one objective, an `OptimalMotion`; of several pushes the one of least regret.

    pushes : `Opposition`s, the first as computed, the others over the spread of the mix
    """
    motion = scene.motion
    regret = len(pushes) > 1
    return optimise(objective, motion.stroke, motion.duration, pushes[0].cart.mass, pushes, limits, regret=regret)
