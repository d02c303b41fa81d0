"""Constants of the light directions, and checks of the lights by their images.

`algebra` makes the constants of the solvers. From four images, `led_levels` finds the LED levels,
`agreement` whether each image is of one light, and `order` of which.
"""
