"""Numbers beside their limits."""

import math

import pytest

from capture.station.domain.digits import told_apart


@pytest.mark.parametrize(
    ("value", "bound", "form", "texts"),
    [
        (3.1, 1.0, ".2f", ("3.10", "1.00")),
        (1.004, 1.0, ".2f", ("1.004", "1.000")),
        (1.0 + 1e-9, 1.0, ".2f", ("1.000000001", "1.000000000")),
        (1.0, 1.0, ".2f", ("1.00", "1.00")),
        (0.05004, 0.05, ".1%", ("5.004%", "5.000%")),
        (12.04, 12.0, ".1f", ("12.04", "12.00")),
        (math.inf, 1.0, ".2f", ("inf", "1.00")),
        (math.nextafter(1e-30, 1.0), 1e-30, ".2f", ("0." + "0" * 17, "0." + "0" * 17)),
    ],
)
def test_a_number_beyond_its_limit_has_the_digits_that_tell_them_apart(
    value: float, bound: float, form: str, texts: tuple[str, str]
) -> None:
    assert told_apart(value, bound, form) == texts
