from .agreement import LightAgreement, light_agreement, like_signed, picture_difference
from .algebra import drop_one_constants, drop_two_inverses, least_squares_weights, three_of_ring
from .balance import light_balance
from .order import Order, light_order

__all__ = [
    "LightAgreement",
    "Order",
    "drop_one_constants",
    "drop_two_inverses",
    "least_squares_weights",
    "light_agreement",
    "light_balance",
    "light_order",
    "like_signed",
    "picture_difference",
    "three_of_ring",
]
