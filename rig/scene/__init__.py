"""Surfaces below the simulated camera, and their ideal images under the lights.

`synthetic` generates surfaces, `material_folder` reads scanned ones, `surfaces` shifts and rotates
them, `render` lights them. Timing, noise and pixel depth are in `rig/simulation`.
"""
