"""Cameras: one file or folder for each kind, with its configuration."""
