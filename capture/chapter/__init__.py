"""Every figure and table of chapter 9 of the thesis, measured on simulated surfaces; the demo.

    plan -> runs           libraries, and matches of test patches (`patches`)
         -> timing         times of one classification
         -> sand           shadow counts, spectra and maps of sand
         -> chapter_*      exhibits: text, numbers, drawing
         -> output         CSV, PNG, JSON, one HTML page

Scene and sensor are those of the simulated rig, without the timing of LEDs and frames.
"""
