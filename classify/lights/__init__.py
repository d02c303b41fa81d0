"""Constants of the light directions, strengths of the lights, and checks of both by the images.

`algebra` makes the constants of the solvers. `flat_field`, `near_light` and `fall_off` give the
strength of each light over the frame. From four images, `led_levels` estimates the LED levels,
`agreement` tests whether each image shows one light, and `order` which light that is. `shading`
tests photographs.
"""
