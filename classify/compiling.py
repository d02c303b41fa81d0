"""How the kernels are compiled."""

__all__ = ["FAST"]

# NaN and infinity stay exact, and so does the order of sums: when it is free ("reassoc"), a kernel
# that numba has just compiled and the same from its cache differ in the last digits, and the first
# run of a machine does not give the numbers of all later ones.
FAST = {"contract", "arcp", "nsz"}
