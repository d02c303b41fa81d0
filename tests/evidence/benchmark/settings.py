"""Settings of the full benchmark and of the quick one."""

from dataclasses import dataclass

from rig import SYNTHETIC_TEXTURES


@dataclass(frozen=True)
class Settings:
    """Sizes and numbers of rounds; the defaults are those of the full benchmark."""

    solver_frame_px: tuple[int, int] = (1944, 2592)  # rows, columns: a sensor of five megapixels
    frames_px: tuple[int, ...] = (512, 1024)  # sides of the frames to classify
    textures: tuple[str, ...] = SYNTHETIC_TEXTURES  # the large libraries are mixed from these
    texture_frame_px: int = 512
    library_sizes: tuple[int, ...] = (30, 1_000, 10_000)  # references
    largest_library: int | None = 100_000  # references in a file; None leaves it out
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
