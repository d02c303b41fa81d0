"""What lies below the simulated camera, and what an ideal camera would see of it.

Surfaces are made (`synthetic`) or scanned (`material_folder`), laid and turned (`surfaces`), and
lit (`render`). No time, no noise and no bits: those are in `simulation`.
"""
