"""`Observation`: the responses and statistics of a part under given gains."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from classify.surface.estimate import FloatMap
from classify.threads import map_in_threads

from .fields import PartFields
from .octave_statistics import octave_statistics
from .responses import ALBEDO_LINES, RELIEF_LINES, pyramid, spot_and_line_responses
from .whitening import whitened
from .window_statistics import window_statistics


@dataclass(frozen=True, eq=False)
class Observation:
    """A part under the gains of a model: pyramids of its whitened relief and albedo."""

    fields: PartFields
    orientation_deg: float
    relief: list[FloatMap]
    albedo: list[FloatMap]

    @classmethod
    def of(cls, fields: PartFields, gains: FloatMap, orientation_deg: float) -> Self:
        """Whiten a part."""
        relief, albedo = map_in_threads(pyramid, whitened(fields, gains, orientation_deg))
        return cls(fields, orientation_deg, relief, albedo)

    def relief_responses(self) -> Iterator[FloatMap]:
        """(h, w) responses to spots and lines of the relief, `RELIEF_RESPONSES` in all."""
        return self._responses(self.relief, RELIEF_LINES)

    def albedo_responses(self) -> Iterator[FloatMap]:
        """(h, w) responses to spots and lines of the albedo, `ALBEDO_RESPONSES` in all."""
        return self._responses(self.albedo, ALBEDO_LINES)

    def octave_statistics(self, anisotropy: bool = False) -> FloatMap:
        """(h, w, d) statistics of the octaves, in the frame of the texture."""
        h, w = self.fields.valid.shape
        angle = self.orientation_deg if anisotropy else None
        return octave_statistics(self.relief, self.albedo, self.fields.weight, angle)[:h, :w]

    def window_statistics(self) -> FloatMap:
        """(h, w, d) statistics of the windows, in the frame of the texture."""
        return window_statistics(self.fields.moments, self.orientation_deg)

    def _responses(
        self, levels: list[FloatMap], lines: tuple[tuple[int, int], ...]
    ) -> Iterator[FloatMap]:
        h, w = self.fields.valid.shape
        for response in spot_and_line_responses(levels, lines, self.orientation_deg):
            yield response[:h, :w]
