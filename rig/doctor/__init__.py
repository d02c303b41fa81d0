"""The checks of ``ps4rig rig doctor``: faults of a rig, with advice.

`diagnosis` makes all checks in order; each other file holds the checks of one part.
"""
