"""Capture sets: light after light, fresh frames only, checked.

`attempts` holds `capture_set`. `light_images` and `fresh_frames` capture with lights switched by
software, `hardware_set` with strobe or trigger. `quality` and `light_checks` reject sets.
"""
