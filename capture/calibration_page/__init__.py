"""What `ps4rig calibrate show` says of a calibration: a summary, and a page with drawings."""
