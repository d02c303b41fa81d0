"""The recipe, and what was taught for it, on disk."""
