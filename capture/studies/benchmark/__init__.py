"""``ps4rig bench``: times and memory of this machine, as ratios to floors of the same run."""
