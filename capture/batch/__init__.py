"""Work on many captured sets: in this process, on all cores or on a cluster."""
