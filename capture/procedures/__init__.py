"""The calibration procedures, each of which measures a part from sets or frames.

The commands in `capture/commands/calibrate_*.py` capture them.
"""
