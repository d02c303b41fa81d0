"""Captured sets: the images of one surface, their metadata, and their files."""
