"""How late things are: a switch until it is acknowledged, light until it is in a frame."""
