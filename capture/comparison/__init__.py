"""Two sets, or two folders of maps, side by side: ``ps4rig compare``."""
