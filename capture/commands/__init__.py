"""The commands of ``ps4rig``: their options and their output. `cli` registers them."""
