"""Captured sets: the images of one surface with all that is known about them, and their files."""
