"""``rig.toml``: the values that say what the rig consists of; a section, a file.

Nothing is opened here. All other folders of `rig` are told by these values what to do.
"""
