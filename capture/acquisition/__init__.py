"""From an open rig to a captured set: light after light, fresh frames only, checked.

`attempts` is the order of things; by software `light_images` and `fresh_frames` take the pictures,
with strobe or trigger `hardware_set` does. `quality` and `light_checks` reject.
"""
