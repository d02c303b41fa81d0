"""``ps4rig bench``: times on this machine, many as ratios to a lower bound, and memory."""
