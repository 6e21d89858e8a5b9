"""Published and closed-form numbers that the program reproduces."""
