"""Pictures of defective parts beside the scores of the detectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from classify.surface.estimate import FloatMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Scores are drawn from 0 to this many limits.
_TOP = 2.0


@dataclass(frozen=True, eq=False)
class Example:
    """A part under the first light, the pixels of its defect, and its scores by detector."""

    texture: str
    defect: str
    image: npt.NDArray[np.generic]
    mask: npt.NDArray[np.bool_]
    scores: Mapping[str, FloatMap]


def draw_examples(figure: Figure, examples: Sequence[Example]) -> None:
    """One row for each part: its image with the outline of the defect, then the scores."""
    detectors = list(examples[0].scores)
    axes = figure.subplots(len(examples), 1 + len(detectors), squeeze=False)
    for row, example in zip(axes, examples, strict=True):
        row[0].imshow(example.image, cmap="gray", interpolation="nearest")
        row[0].contour(example.mask, levels=[0.5], colors="#f4c542", linewidths=0.8)
        row[0].set_title(f"{example.texture}\n{example.defect}", fontsize=7)
        for ax, (name, score) in zip(row[1:], example.scores.items(), strict=True):
            shown = ax.imshow(score, cmap="magma", vmin=0.0, vmax=_TOP, interpolation="nearest")
            ax.set_title(f"{name}: {np.nanmax(score):.2f}", fontsize=7)
        for ax in row:
            ax.set_axis_off()
    figure.colorbar(shown, ax=axes, shrink=0.6, label="score; 1 is the limit")
