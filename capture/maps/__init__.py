"""The maps of a solved surface: computed, as pictures, as files, and on one page."""
