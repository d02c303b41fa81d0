"""The recipe and the files that teaching made for it."""
