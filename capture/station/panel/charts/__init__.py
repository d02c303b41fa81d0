"""Charts of the statistics: what they show, their lines and areas, the same as PNG."""
