"""``ps4rig demo``: the whole job on the simulated rig, and the report of it."""
