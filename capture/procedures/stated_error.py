"""The error of a part in the words of its record."""


def stated_error(share: float, decimals: int) -> str:
    """Return an error in percent for a sentence such as "known to 0.05%".

    An error that rounds to 0 is given as the smallest that does not: "to 0.00%" would claim that
    there is none.

    >>> stated_error(0.0123, 1), stated_error(0.00001, 2)
    ('1.2%', '0.01%')
    """
    return f"{max(share, 0.01 * 10.0**-decimals):.{decimals}%}"
