"""Size of the machine: balances of work and mix, duration of a pass, motor, guide wheels and bearings."""
