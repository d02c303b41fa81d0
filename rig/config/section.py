"""What all sections of ``rig.toml`` have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

__all__ = ["Section"]


class Section(BaseModel):
    """Values that cannot be changed; a key that is not known is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")
