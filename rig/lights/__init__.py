"""The light controller: finding it, its commands, keeping it alive, flashing it.

`driver` has the commands, `link` one open line and its protocol, `serial_line` the bytes.
Nothing here depends on whether a real or a simulated board answers.
"""
