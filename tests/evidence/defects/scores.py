"""Scores of detectors by the field's metrics: areas under ROC and PRO curves.

Both curves are integrated exactly, without a list of thresholds. The area under a ROC curve is the
share of pairs of a defective and a good value in which the defective one is higher (Mann and
Whitney 1947). PRO is the share of a region's pixels above a threshold, averaged over regions
(Bergmann et al., "The MVTec anomaly detection dataset", International Journal of Computer Vision
129, 2021); its curve over the false-positive rate is a mean of step functions, one for each pixel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

Values = npt.NDArray[np.floating]

PRO_LIMIT = 0.3
"""Highest false-positive rate of the PRO curve, as in the benchmark that defined it."""


def auroc(defective: Values, good: Values) -> float:
    """Area under the ROC curve, 0 to 1; ties count half. NaN without a value on either side."""
    if not (len(defective) and len(good)):
        return float("nan")
    return 1.0 - float(_false_positive_rates(defective, good).mean())


def aupro(regions: Sequence[Values], good: Values, limit: float = PRO_LIMIT) -> float:
    """Area under the PRO curve up to a false-positive rate, relative to `limit`, 0 to 1.

    Parameters
    ----------
    regions
        Scores of the pixels of each defect. Every defect has the same weight.
    good
        Scores of all pixels outside defects.
    """
    if not (regions and len(good)):
        return float("nan")
    # A pixel counts from the false-positive rate at which the threshold falls to its score.
    shares = [
        np.clip(1.0 - _false_positive_rates(scores, good) / limit, 0.0, 1.0).mean()
        for scores in regions
    ]
    return float(np.mean(shares))


def _false_positive_rates(scores: Values, good: Values) -> npt.NDArray[np.float64]:
    """Share of good values above each score, and half of those equal to it."""
    ranked = np.sort(good)
    below = np.searchsorted(ranked, scores, "left") + np.searchsorted(ranked, scores, "right")
    return 1.0 - 0.5 * below / len(ranked)
