"""Trained references, what they say of a surface, and how often they are right.

`ps4lib` is the file of a library.
"""
