"""Ten tasks with `compact` in Python, each of at most five lines; every block runs and is type-checked by a test."""

import numpy as np

import compact

# [load] Load a scene, and change a key.
scene = compact.load_scene("small", **{"accuracy.engine": "column"})
wetter = scene.replaced(**{"mix.moisture": 0.11})
print(scene.mix.moisture, wetter.mix.moisture)

# [roll] Roll at five speeds into a DataFrame, in SI units per metre of roller.
contacts = scene.roll([0.05, 0.1, 0.15, 0.2, 0.25])
frame = contacts.to_dataframe()
print(frame[["load", "resistance", "coefficient"]])

# [plot] Plot load and rolling-resistance coefficient over the speed, and save the figure.
figure = contacts.plot()
figure.savefig("loads.png")

# [fields] Compute the fields below the roller, write VTU, and open it in pyvista.
collection = scene.roll(0.2, engine="fem").to_vtk("layer")
grid = compact.read_fields(collection).to_pyvista()
print(grid.cell_data["pressure"].max())

# [rank] Rank the motion laws by a demand on the drive.
ranking = scene.rank(by="peak_power")
print(ranking.to_dataframe())

# [law] Rank an own law with them: the travel [m] as a function of time [s].
own = scene.rank(by="peak_power", laws={"sine": lambda t: 0.2 * (1 - np.cos(np.pi * t / 3.0))})
print(own[0].law)

# [resistance] Rank under an own resistance [N]: a table, or any function F(v, a).
table = compact.tabulated_resistance(speeds=[0.05, 0.1, 0.2, 0.4], forces=[2.9e3, 3.1e3, 3.3e3, 3.5e3])
print(scene.rank(by="peak_force", resistance=table)[0])
print(scene.rank(by="peak_force", resistance=lambda v, a: 3e3 * np.sign(v) + 200.0 * (v + a))[0])


# [material] Roll over an own material: its stress as a function of the strain history.
def update(stress: np.ndarray, strain: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    stiffness = np.diag([8e6, 8e6, 8e6, 2e6]) if strain[1] < 0 else np.diag([80e6, 80e6, 80e6, 20e6])
    return stress + stiffness @ strain, stress + stiffness @ strain, stiffness


mix = compact.StateUpdate(update, initial_state=np.zeros(4), fed_density_ratio=0.94)
print(scene.roll([0.1], material=mix).to_dataframe())

# [sweep] Sweep two keys into xarray.
dataset = scene.sweep({"mix.moisture": [0.09, 0.1, 0.11], "layer.fed_density_ratio": "0.93:0.96:4"})
print(dataset["resistance"].sel(moisture=0.1).to_pandas())

# [process] Compute the forming process: strokes over a moving mould.
process = compact.load_scene("process").forming_process()
strokes = process.to_dataframe()
print(strokes[["load", "resistance", "density_ratio"]].tail())
