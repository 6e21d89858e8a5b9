"""Published numbers of the motion laws and the cart, kept as data: author, section and erratum beside each.

D is the monograph, A and B the papers on the reversal, as in `theory.md`; D-1 ... name the rows of `errata.md`.
Normalised: velocity by stroke/T, acceleration by stroke/T^2, jerk by stroke/T^3, snap by stroke/T^4; run-up and
run-down of T/6 where a law has them. Exact values are kept exact; `laws.csv` holds the same ones.
"""

from fractions import Fraction
from math import pi, sqrt

from compact.machine.cart import Cart

over = Fraction  # over(15, 8) is 15/8

# Peaks of the fifteen laws of D: section, (velocity, acceleration, jerk, snap), C without dwell, C with dwells.
LAWS_OF_D = {
    "constant-velocity": ("2.1", (1, 0, 0, 0), 0, 0),
    "cubic": ("2.2", (over(3, 2), 6, 12, 0), 2, 1),
    "quintic": ("2.3", (over(15, 8), 10 * sqrt(3) / 3, 60, 360), 2, 2),
    "septic": ("2.4", (over(35, 16), 84 * sqrt(5) / 25, over(105, 2), 840), 4, 3),
    "combined-2": ("2.6", (over(9, 8), over(27, 2), 81, 0), 2, 1),
    "combined-3": ("2.7", (over(15, 13), over(160, 13), over(6480, 13), over(155520, 13)), 2, 2),
    "combined-4": ("2.8", (over(7, 6), over(9072, 625), over(1134, 25) + 3024 * sqrt(6) / 25, 30240), 4, 3),
    "reversal-2": ("3.1", (over(6, 5), over(36, 5), 0, 0), 1, 1),
    "reversal-3": ("3.2", (over(6, 5), over(54, 5), over(1296, 5), over(15552, 5)), 2, 2),
    "reversal-4": ("3.3", (over(6, 5), over(27, 2), 144 * sqrt(3), 15552), 3, 3),
    "reversal-3-free-acceleration": ("4.1", (over(8, 7), over(72, 7), over(864, 7), over(5184, 7)), 2, 1),
    "reversal-4-free-acceleration": ("4.2", (over(48, 43), over(540, 43), 2880 * sqrt(3) / 43, over(155520, 43)), 3, 1),
    "reversal-4-free-jerk": ("4.3", (over(6, 5), over(27, 2), 144 * sqrt(3), 15552), 3, 3),
    "reversal-4-free-both": ("4.4", (over(48, 43), over(540, 43), 2880 * sqrt(3) / 43, over(155520, 43)), 3, 1),
}

# D 2.5 at d1 = 0.5, d2 = 0.3. Digits: `laws.csv`, from the closed form, not printed in D, which has a = 0.245 m/s^2
# (D-5: a table by 10 degrees misses the peak) and jerk 1.532 m/s^3 at stroke 0.4 m, T 3 s.
COMPLEX_LAW = ("2.5", (1.6954401560265956, 5.5881101655165102, 103.39365414326548, 1391.2878389232931), 2, 2)

# D ch. 5, printed peaks of acceleration [m/s^2] and jerk [m/s^3] at stroke 0.4 m, T 3 s: (printed, right), with the
# erratum where they differ; None where D prints no number.
CHAPTER_5 = {
    "septic": ((0.334, 0.778), None),
    "complex": ((0.245, 1.532), "D-5: a read from a table by 10 degrees, right 0.24836"),
    "combined-2": ((0.6, 1.2), None),
    "combined-3": ((0.551, 7.44), "D-6: 2/3 cut to 0.66, right 64/117 and 96/13"),
    "combined-4": ((0.614, 5.04), "D-7: peak at tau = 2/5 missed, right 0.64512 and 5.06149"),
    "reversal-2": ((0.32, None), None),
    "reversal-3": ((0.48, 3.84), None),
    "reversal-4": ((0.6, 3.686), "D-8: jerk read at tau = 1/5, right 3.69504"),
    "reversal-3-free-acceleration": ((0.48, 1.846), "D-1: closure with x1 = v t1/2, right 16/35 and 64/35"),
    "reversal-4-free-acceleration": ((0.6, 1.846), "D-2: speed 6/5 for 48/43, right 24/43 and 1.71862"),
    "reversal-4-free-jerk": ((0.6, 3.686), "D-8, as reversal-4"),
    "reversal-4-free-both": ((0.6, 1.846), "D-2, B-2"),
}

# VDI 2143 (dimensionless peaks of the standard laws): (C_v, C_a, C_j).
# Entered from the closed forms; the rounded values are the table's, not checked against the printed sheet.
VDI_2143 = {
    "parabolic": (2, 4, 0),  # jerk 0 inside the pieces, infinite where they join
    "harmonic": (pi / 2, pi**2 / 2, pi**3 / 2),  # 1.571, 4.935, 15.503
    "cycloidal": (2, 2 * pi, 4 * pi**2),  # 2, 6.283, 39.478
    "modified-trapezoid": (2, 8 * pi / (2 + pi), 32 * pi**2 / (2 + pi)),  # 2, 4.888, 61.426
    "quintic": (1.875, 5.7735, 60.0),  # 3-4-5
    "septic": (2.1875, 7.5132, 52.5),  # 4-5-6-7
}

# Share of the run-up's steady travel that the run-up itself covers, x1 = A v t1: D 2.6-2.8, 3, 4; A (21), B (21).
RUN_UP_TRAVEL = {
    "combined-2": over(2, 3),
    "combined-3": over(3, 5),
    "combined-4": over(4, 7),
    "reversal-2": over(1, 2),
    "reversal-3": over(1, 2),
    "reversal-4": over(1, 2),
    "reversal-3-free-acceleration": over(5, 8),
    "reversal-4-free-acceleration": over(11, 16),
    "reversal-4-free-jerk": over(1, 2),
    "reversal-4-free-both": over(11, 16),
}

# J_k per stroke at stroke = T = 1: (law, k, value).
CRITERIA = {
    "cubic energy": ("cubic", 1, over(6, 5)),  # D-9: D prints 2.25, the ratio of peak kinetic energies
    "quintic energy": ("quintic", 1, over(10, 7)),  # D-9: D prints 3.45
    "combined-2": ("combined-2", 2, over(81, 4)),  # D-11, 20.25: called optimal in D, 17.28 is
    "reversal-2": ("reversal-2", 2, over(432, 25)),
    "combined-3": ("combined-3", 3, 11043),  # D-11, rounded there
    "reversal-3": ("reversal-3", 3, 7465),
    "combined-4": ("combined-4", 4, 26.13e6),
    "reversal-4": ("reversal-4", 4, 16.12e6),
}

# at fixed stroke the optimal run-up travel is x1 = (88/175) v t1, and x1 = v t1/2 loses 0.114 % of the criterion.
BEST_TRAVEL_AT_FIXED_STROKE, LOSS_OF_HALF = over(88, 175), 0.00114
# D-12: a phase alone would turn with jerk (20/3) v/t1^2 and travel (5/9) v t1.
LONE_TURNING_JERK, LONE_TRAVEL = over(20, 3), over(5, 9)

# Paper C: two rollers, R 9740 N each, G 10 kN, pin .65 m ahead; the massless cart leaves the inertia out.
CART_OF_C = Cart(
    mass=1000.0,
    weight=10e3,
    roller_positions=(0.27, -0.27),
    roller_reactions=(9740.0, 9740.0),
    guide_positions=(0.37, -0.37),
    pin_position=0.65,
    pin_height=0.1,
    roller_radius=0.11,
    guide_wheel_diameter=0.046,
    guide_friction=0.008,
)
