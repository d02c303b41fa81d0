"""The parts of a `Calibration`, of one rig at one setting, and their estimation.

Arrays in, arrays out. The parts are in `dark`, `photon_transfer` and `calibration`, and in
`classify.lights.flat_field`. `capture/procedures/` measures and `capture/calibration/` keeps them.
"""
