"""The calibration of a rig: its file, its settings, and the search for that of a set.

A procedure that measures a part takes captured sets or frames, and returns the part with its record
of quality. The commands in `capture/commands/calibrate/` capture them.
"""
