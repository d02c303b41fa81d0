"""GigE Vision and USB3 Vision cameras, through the library Aravis.

`aravis` wraps the library, `camera` is the driver of ps4rig.
"""
