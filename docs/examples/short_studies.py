"""Studies of the gallery in a few lines of the Python interface; a test runs every block."""

import compact

scene = compact.load_scene("small", **{"accuracy.engine": "column"})

# [rank_laws] First law by each engine.
for engine in ("formula", "column"):
    first = scene.replaced(**{"accuracy.engine": engine}).rank(by="peak_power")[0]
    print(f"{engine:<10}{first.law:<12}{first.value:8.0f} W, {first.margin:.1%} to the next")

# [duration] First law over the duration of a pass.
for duration in (0.5, 1.0, 2.0, 3.0):
    first = scene.replaced(**{"motion.duration": duration}).rank(by="peak_force")[0]
    print(f"{duration:4.1f} s  {first.law:<12}{first.value:8.0f} N")

# [speed_dependence] Resistance over speed by columns and by the viscoelastic layer.
for engine in ("column", "spectral"):
    print(engine, scene.roll([0.02, 0.1, 0.5], engine=engine).to_dataframe()["resistance"].to_list())

# [moisture_density] Load over moisture and density.
table = scene.sweep({"mix.moisture": [0.09, 0.10, 0.11], "mix.density_ratio": [0.96, 0.97, 0.98]})
print(table["load"].to_pandas())

# [elastic_drive] Peak force over the stiffness of the drive.
for stiffness in (1e5, 1e6, 1e7):
    drive = {"drive.kind": "elastic", "drive.stiffness": stiffness, "drive.damping": 1e3}
    print(f"{stiffness:8.0e} N/m {scene.replaced(**drive).rank(by='peak_force')[0].value:8.0f} N")
