"""Two surfaces compared as textures: their distance, and the angle between them."""

from dataclasses import dataclass

from classify.methods import DEFAULT_CLASSIFIER
from classify.surface.estimate import SurfaceEstimate
from classify.texture.spectra import segment_for

from .match import Match
from .texture_library import TextureLibrary
from .training import TrainingRow, observe


@dataclass(frozen=True)
class TexturePair:
    """How two textures differ."""

    distance: float  # mean of both ways; 0 equal, 1 as two quarters of one frame
    angle_deg: float  # from the first to the second, anticlockwise, [-90, 90)
    sharpness: float  # of the angle: 0 not determined, 1 exactly
    blur_px: float  # sigma of the Gaussian by which the second is blurrier; negative: sharper


def compare_textures(first: SurfaceEstimate, second: SurfaceEstimate) -> TexturePair:
    """Compare two surfaces as the joint classifier does, without any training."""
    segment_px = min(segment_for(first.shape), segment_for(second.shape))
    there, back = _match(first, second, segment_px), _match(second, first, segment_px)
    return TexturePair(
        distance=0.5 * (there.distance + back.distance),
        angle_deg=((there.orientation_deg or 0.0) + 90.0) % 180.0 - 90.0,
        sharpness=there.sharpness or 0.0,
        blur_px=there.blur_px or 0.0,
    )


def _match(known: SurfaceEstimate, test: SurfaceEstimate, segment_px: int) -> Match:
    row = TrainingRow("known", observe(known, segment_px, DEFAULT_CLASSIFIER), 0.0)
    library = TextureLibrary.from_observations([row], segment_px, planar=known.planar)
    return library.match(library.observe(test))
