"""Chapter 9 of the thesis again, on simulated surfaces: every figure and table, and more.

    plan -> pictures of one surface, shadow counts        (`gallery`, `shadow_counts`)
         -> libraries -> answers to turned patches        (`training`, `exams`)
         -> exhibits: what is said, its numbers, its drawing (`exhibits`)
         -> CSV, PNG, JSON, one page                      (`output`, `page`)

Scene and sensor are those of the simulated rig; the timing of LEDs and frames is left out.
"""
