"""A part in pieces: windows of a part compared with windows of good parts, and its whole.

moments       -> products of slopes and log albedo in cells, for each octave
features      -> what a window looks like, in the frame of the texture
spots         -> what a spot's surroundings let expect of it
look_alikes   -> nearest good windows, and limits from good parts that are left out
whole_part    -> scale, handedness and power in octaves of the whole part
piece_model   -> all of these for one texture
learning      -> from good parts to the model
"""
