"""Complete tables of drives in a scene, which tests change."""

MOTOR = {
    "curve": "kloss", "torque": 40.0, "speed": 157.0, "breakdown_slip": 0.15, "gear_ratio": 150.0, "inertia": 0.01,
    "flywheel_inertia": 50.0,
}  # fmt: skip
HYDRAULICS = {
    "piston_area": 1e-3, "supply_pressure": 8e6, "pump_flow": 5e-4, "valve_area": 2e-5, "discharge_coefficient": 0.62,
    "oil_density": 870.0, "transition_drop": 1e3, "bulk_modulus": 1.4e9, "dead_volume": 1e-4,
}  # fmt: skip
