"""Every figure and table of chapter 9 of the thesis, measured on simulated surfaces; the demo.

    plan -> runs           libraries, and matches of test patches
         -> results        all measurements of a plan
         -> exhibits       figures and tables: text, numbers, drawing by `plots`
         -> output         CSV, PNG, JSON, one HTML page

Scene and sensor are those of the simulated rig, without the timing of LEDs and frames.
"""
