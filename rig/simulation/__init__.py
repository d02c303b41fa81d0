"""Simulated hardware of a rig: board and LEDs, camera and sensor, and their faults.

The drivers are the same as for real hardware. `rig.scene` renders the parts, `firmware_sim` is the
controller; `devices` connects the simulated rig to real device files.
"""
