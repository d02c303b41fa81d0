"""GigE Vision and USB3 Vision cameras, through the library Aravis.

`aravis` wraps the library, `camera` is what ps4rig makes of it.
"""
