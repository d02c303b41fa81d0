"""Constants of the light directions, and checks of the lights by their images.

`algebra` makes the constants of the solvers. From four images, `led_levels` estimates the LED
levels, `agreement` tests whether each image shows one light, and `order` which light that is.
"""
