"""GigE Vision and USB3 Vision cameras, through the C library Aravis.

`aravis` has its functions, `camera` what ps4rig makes of them.
"""
