"""Settings of the full benchmark and of the quick one."""

from __future__ import annotations

from dataclasses import dataclass

from rig import SYNTHETIC_TEXTURES

__all__ = ["FULL", "QUICK", "Settings"]


@dataclass(frozen=True)
class Settings:
    """Sizes and numbers of rounds.

    Attributes
    ----------
    solver_frame_px
        Rows and columns for the solvers, by default those of a common sensor of five megapixels.
    frames_px
        Sides of the frames for the classification.
    textures, texture_frame_px
        Textures that the large libraries are mixed from, and side of their frames.
    library_sizes
        References of each library to search.
    largest_library
        References of one more library, in a file; None leaves it out.
    """

    solver_frame_px: tuple[int, int] = (1944, 2592)
    frames_px: tuple[int, ...] = (512, 1024)
    textures: tuple[str, ...] = SYNTHETIC_TEXTURES
    texture_frame_px: int = 512
    library_sizes: tuple[int, ...] = (30, 1_000, 10_000)
    largest_library: int | None = 100_000
    solver_rounds: int = 40
    numpy_rounds: int = 4
    pipeline_rounds: int = 60
    match_rounds: int = 5
    match_queries: int = 50
    recall_queries: int = 1000
    largest_recall_queries: int = 100


FULL = Settings()
QUICK = Settings(
    largest_library=None,
    solver_rounds=15,
    numpy_rounds=2,
    pipeline_rounds=20,
    match_rounds=1,
    recall_queries=100,
)
"""A minute on two cores."""
