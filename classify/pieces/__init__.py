"""A part in pieces: windows of a part compared with windows of good parts, and its whole.

features      -> moments of cells in each octave; features of windows in the frame of the texture
spots         -> departure of a spot from a prediction by its surroundings
look_alikes   -> distance of a window from the nearest good windows
piece_model   -> these for one texture, and scale, handedness and octaves of the whole part
learning      -> from good parts to the model
"""
