"""`Observation`: the responses and statistics of one part under given whitening gains."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from classify.surface.estimate import FloatMap
from classify.threads import map_in_threads

from .fields import PartFields
from .local_statistics import local_statistics
from .responses import (
    ALBEDO_LINES,
    RELIEF_LINES,
    pyramid,
    spot_and_line_responses,
)
from .whitening import whitened


@dataclass(frozen=True, eq=False)
class Observation:
    """A part in front of a model: pyramids of its whitened relief and albedo."""

    fields: PartFields
    orientation_deg: float
    pyramids: tuple[list[FloatMap], list[FloatMap]]

    @classmethod
    def of(cls, fields: PartFields, gains: FloatMap, orientation_deg: float) -> Self:
        """Whiten a part."""
        relief, albedo = map_in_threads(pyramid, whitened(fields, gains, orientation_deg))
        return cls(fields, orientation_deg, (relief, albedo))

    def relief_responses(self) -> Iterator[FloatMap]:
        """(h, w) responses to spots and lines of the relief, `RELIEF_RESPONSES` in all."""
        return self._responses(0, RELIEF_LINES)

    def albedo_responses(self) -> Iterator[FloatMap]:
        """(h, w) responses to spots and lines of the albedo, `ALBEDO_RESPONSES` in all."""
        return self._responses(1, ALBEDO_LINES)

    def _responses(self, field: int, lines: tuple[tuple[int, int], ...]) -> Iterator[FloatMap]:
        h, w = self.fields.valid.shape
        levels = self.pyramids[field]
        for response in spot_and_line_responses(levels, lines, self.orientation_deg):
            yield response[:h, :w]

    def statistics(self) -> FloatMap:
        """(h, w, d) local statistics in the frame of the texture."""
        h, w = self.fields.valid.shape
        return local_statistics(*self.pyramids, self.fields.weight, self.orientation_deg)[:h, :w]
