"""Capture sets: fresh frames under one light after the other, and checks of the images.

`attempts` holds `capture_set`. `light_images` and `fresh_frames` capture with lights switched by
software, `hardware_set` with strobe or trigger. `light_checks` rejects sets.
"""
