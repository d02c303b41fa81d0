"""What of a surface is compared as texture.

`fields` are slopes and albedo without their outliers; all else is measured from them.
"""
