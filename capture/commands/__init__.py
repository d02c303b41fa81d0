"""The commands of ``ps4rig``: their options and what they print. `cli` registers them."""
