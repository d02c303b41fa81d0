"""``rig.toml``: the values that describe a rig, one file per section.

No device is opened here. All other folders of `rig` are configured by these values.
"""
