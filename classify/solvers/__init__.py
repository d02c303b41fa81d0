"""From images under known lights to a surface.

`solver` checks the input and looks the method up; each other file holds one method or a part of it.
"""
