"""``ps4rig calibrate show``: a summary of a calibration, and a page with drawings."""
