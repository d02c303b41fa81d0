"""`Observation`: the responses and statistics of one part under given whitening gains."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from classify.surface.estimate import FloatMap

from .fields import PartFields
from .responses import line_kernels, local_statistics, pyramid, spot_and_line_responses
from .whitening import whitened


@dataclass(frozen=True, eq=False)
class Observation:
    """A part in front of a model: pyramids of its whitened relief and albedo."""

    fields: PartFields
    orientation_deg: float
    pyramids: tuple[list[FloatMap], list[FloatMap]]
    kernels: list[FloatMap]

    @classmethod
    def of(cls, fields: PartFields, gains: FloatMap, orientation_deg: float) -> Self:
        """Whiten a part."""
        relief, albedo = whitened(fields, gains, orientation_deg)
        pyramids = (pyramid(relief), pyramid(albedo))
        return cls(fields, orientation_deg, pyramids, line_kernels(orientation_deg))

    def responses(self, field: int) -> Iterator[FloatMap]:
        """Spots and lines of relief (0) or albedo (1), (h, w) each; see `responses.py`."""
        h, w = self.fields.valid.shape
        for response in spot_and_line_responses(self.pyramids[field], self.kernels):
            yield response[:h, :w]

    def statistics(self) -> FloatMap:
        """(h, w, d) local statistics in the frame of the texture."""
        h, w = self.fields.valid.shape
        return local_statistics(*self.pyramids, self.fields.weight, self.orientation_deg)[:h, :w]
