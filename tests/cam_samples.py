"""Cams of the tests: laws, followers and cams of one stroke and duration."""

import numpy as np

from compact.cams.profile import Cam, FlatFace, Pointed, RollerFollower
from compact.motion.profile import LAWS, Cycle, law

STROKE, DURATION = 0.4, 3.0
FOLLOWERS = (Pointed(), RollerFollower(0.03), FlatFace())
SHOCK = ("constant-velocity", "gear-sector")
SMOOTH = [name for name in LAWS if name not in SHOCK]
KINDS = ("quintic", "complex", "reversal-4", "crank", "parabolic", "modified-trapezoid")  # one of each kind
BY_NAME = {"ids": lambda value: value if isinstance(value, str) else type(value).__name__}


def cycle(name, far_dwell=0.0, near_dwell=0.0, stroke=STROKE, **shape):
    rod = {"rod_length": 2 * stroke} if name == "crank" else {}
    return Cycle(law(name, stroke, DURATION, **rod, **shape), far_dwell, near_dwell)


def made(name, follower, breadth=1.0, **options):
    return Cam(cycle(name, **options), breadth, follower)


def direction(angle):
    return np.array([np.cos(angle), np.sin(angle)])
