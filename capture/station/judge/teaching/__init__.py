"""From sets of good and bad parts to a new version of a recipe."""
