"""What the solvers find out about a surface, and what can be told from it and the images."""
