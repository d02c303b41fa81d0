"""From images under known lights to a surface.

`solver` checks what is given and chooses; the other files are its kernels.
"""
