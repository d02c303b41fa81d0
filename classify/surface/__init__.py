"""The result of a solver, and diagnostics computed from it and the images."""
