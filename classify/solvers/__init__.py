"""From images under known lights to a surface.

`solver` checks the input and calls the method; each other file holds one method or a part of one.
"""
