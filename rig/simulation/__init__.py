"""Simulated hardware of a rig: board and LEDs, camera and sensor, and their faults.

The drivers above are the real ones. `scene` has the parts that the camera sees, `firmware_sim` the
controller; `devices` puts the simulated rig behind real device files.
"""
