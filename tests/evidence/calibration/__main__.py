"""Write a page about calibrated rigs with faults: `python -m tests.evidence.calibration DIR`.

rigs          -> simulated rigs with faults and the ideal one; sets of parts and of targets
procedures    -> the calibration of a rig, measured as the commands of `ps4rig calibrate` do
normal_errors -> angular errors after each step of the calibration, beside the ideal rig
lights        -> errors of light positions and directions, from a sheet and from spheres
exhibits      -> tables and pictures
run           -> the page and its files
"""

import argparse
from pathlib import Path

from .run import reproduce_calibration

parser = argparse.ArgumentParser(
    prog="python -m tests.evidence.calibration",
    description="Measure the benefit of each part of a calibration on simulated rigs, in degrees.",
)
parser.add_argument("output", type=Path, metavar="DIR", help="folder for the page and its files")
print(reproduce_calibration(parser.parse_args().output))
