"""The calibration of a rig: its file, its settings, and where a set finds it.

A procedure that measures a part takes captured sets or frames, and returns the part with its record
of quality. The commands in `capture/commands/calibrate/` capture them.
"""
