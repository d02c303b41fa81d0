"""The checks of ``ps4rig rig doctor``: what is wrong with a rig, and what to do about it.

`diagnosis` makes all checks in order; each other file holds the checks of one part.
"""
