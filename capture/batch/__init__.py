"""Many captured sets: what is done with each, in this process, on all cores or on a cluster."""
