"""Captured sets and their heights in the files of other programs."""
