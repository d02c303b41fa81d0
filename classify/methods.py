"""Names of solvers and classifiers, in a file that loads no numerics."""

from typing import Literal, get_args

Method = Literal[
    "ps3a", "ps3b", "ps3c", "ps3d", "ps4", "least_squares", "rushmeier", "drbohlav", "ps4_robust"
]
METHODS: tuple[Method, ...] = get_args(Method)

CLASSIFIER_NAMES = (
    "joint",
    "spectra_2d",
    "spectra_2d_power",
    "polar_radial",
    "polar",
    "image_polar",
    "varma_zisserman",
)
DEFAULT_CLASSIFIER = "joint"
