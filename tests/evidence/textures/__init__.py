"""Textures beyond chapter 9: classifiers, materials, faults of the rig, unknown textures.

plan       -> textures, conditions and runs, with `faults` and `materials`
open_set   -> matches of patches with and without their class
results    -> what the exhibits read
comparison, days, rejection -> exhibits
run        -> CSV, PNG, JSON, one HTML page
"""
