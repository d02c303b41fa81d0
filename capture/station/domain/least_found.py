"""`LeastFound`: how strong a defect must be to be found on a taught texture."""

from typing import Any, Literal

from pydantic import FiniteFloat, NonNegativeFloat, PositiveFloat

from classify.base.models import Record


class LeastFound(Record):
    """The weakest defect of a kind and size that is found in 9 of 10 places."""

    kind: Literal["scratch", "dent", "stain"]
    size_px: PositiveFloat  # width of a scratch, diameter of the others
    # Depth in px, or contrast as a share of the albedo; None if the strongest is not found.
    strength: NonNegativeFloat | None
    strongest: FiniteFloat  # depth or contrast that was tried
    mm_per_px: PositiveFloat | None = None

    @property
    def is_stain(self) -> bool:
        """Whether its strength is a contrast."""
        return self.kind == "stain"

    def __str__(self) -> str:
        what = f"a {self.kind} {self._length(self.size_px)} wide"
        strength = self.strongest if self.strength is None else self.strength
        how = f"{strength:.0%} darker" if self.is_stain else f"{self._length(strength)} deep"
        if self.strength is None:
            return f"{what} is not found in 9 of 10 places, even if {how}"
        return f"{what} must be {how} to be found in 9 of 10 places"

    def fields(self) -> dict[str, Any]:
        """Return it as fields of JSON; a depth or contrast of null is not found."""
        unit = "contrast" if self.is_stain else "depth_px"
        found = {"kind": self.kind, "size_px": self.size_px, unit: self.strength}
        if self.mm_per_px is not None:
            found["size_mm"] = self.size_px * self.mm_per_px
            if not self.is_stain:
                strength = self.strength
                found["depth_mm"] = None if strength is None else strength * self.mm_per_px
        return found | {"text": str(self)}

    def _length(self, length_px: float) -> str:
        if self.mm_per_px is None:
            return f"{length_px:.2g} px"
        return f"{length_px:.2g} px ({length_px * self.mm_per_px:.2g} mm)"
