"""Benefit of each part of a calibration on simulated rigs with faults, in degrees.

rigs       -> simulated rigs with faults and the ideal one; sets of parts and of targets
procedures -> the calibration of a rig, measured as the commands of `ps4rig calibrate` do
errors     -> angular errors after each step of the calibration, beside the ideal rig
lights     -> errors of light positions and directions, from a sheet and from spheres
exhibits   -> tables and pictures
run        -> the page and its files
"""
