"""Costs of the stages of a study, by which the progress of the main job is weighed.

All are seconds of processor time on one core of a machine of 2026, measured on the published machine
(studies/scenes/loveikin-2015*.toml) at the tolerance of its scene. Only their ratios matter.
"""

CONTACT = {"formula": 0.001, "column": 0.03, "spectral": 0.02, "fem": 0.55, "compaction": 60.0}  # by engine
FIRST = {"formula": 0.0, "column": 0.3, "spectral": 0.07, "fem": 0.7, "compaction": 15.0}  # more, of the first of them
RESISTANCE = {"column": 0.03, "spectral": 0.016, "fem": 0.45, "compaction": 45.0}  # a contact that starts from another
CROWDED = 1.5  # times that contacts take longer while other processes have the engines beside
ADDED_MASS = {"spectral": 0.046, "fem": 0.6}
DRIVEN = {"fem": 0.15, "compaction": 45.0}  # a roller under a torque
RUN = {"rigid": 0.0025, "crank": 0.0025, "hydraulic": 0.05, "elastic": 0.017, "motor": 0.018}  # of a law, by drive
RUN_OVER_A_LAYER = {"rigid": 0.014, "crank": 0.014, "hydraulic": 0.014, "elastic": 0.035, "motor": 0.035}  # more
SECOND_PASS = {"formula": 0.0, "column": 0.01, "spectral": 0.0, "fem": 0.0, "compaction": 20.0}  # back
SPEEDS_ADDED = {"column": 1, "spectral": 7, "fem": 7, "compaction": 3}  # to those of the scene, for the map of it
REPORT = {"formula": 1.1, "column": 2.0, "spectral": 2.9, "fem": 1.0, "compaction": 1.0}  # with its sensitivities
TORQUES = 3  # at each speed, of a driven roller
OTHERS = {
    "contact": 0.01,
    "kept": 0.01,
    "laws": 0.003,
    "cams": 0.0,
    "cams measured": 0.02,
    "crank": 0.03,
    "fields": 0.09,
    "figures": 0.35,
    "rankings": 0.3,
    "passage": 0.3,
    "run-up": 0.3,
}
OPTIMISED = 2.0  # a law that is made for the machine
BY_OTHERS = 0.3  # of a task that another process has, the part that this one waits for


def cost(stage, engine, drive, layered, crowded):
    """Cost of one run of a stage [s], other than "laws" that are optimised and "beside".

    Parameters
    ----------
    stage : name as in `Study.counts`
    engine, drive : of the scene
    layered : whether the resistance is a map over speed
    crowded : whether other processes are at work meanwhile

    Raises KeyError for a stage that is not in the tables.
    """
    if stage == "runs":
        return RUN[drive] + RUN_OVER_A_LAYER[drive] * layered
    by_engine = {
        "rolled": CONTACT, "resistance": RESISTANCE, "added mass": ADDED_MASS, "driven": DRIVEN, "report": REPORT,
        "second pass": SECOND_PASS,
    }  # fmt: skip
    found = by_engine[stage][engine] if stage in by_engine else OTHERS[stage]
    return found * CROWDED if crowded and stage in ("rolled", "resistance") else found
