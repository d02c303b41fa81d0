"""What all faces of a station see of it."""
