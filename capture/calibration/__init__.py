"""The calibration of a rig: its parts, its settings, its file, and the search for the file."""
