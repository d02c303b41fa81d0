"""What the lights alone decide, and what the images say about the lights.

`algebra` makes the constants of the solvers; `balance`, `agreement` and `order` find out from four
images how strong the lights are, whether each image is of its light, and of which.
"""
