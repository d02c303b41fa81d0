"""``ps4rig demo``: capture, train and classify on the simulated rig, with a report."""
