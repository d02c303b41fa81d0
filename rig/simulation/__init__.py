"""What is hardware in a real rig: board and LEDs, camera and sensor, and what goes wrong with them.

What the camera looks at is in `scene`, the controller in `firmware_sim`. The drivers above are the
real ones; `devices` puts the same below real device files, for other programs.
"""
