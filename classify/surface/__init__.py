"""The result of a solver, and what follows from it and the images."""
