"""Write captured sets and heights in file formats of other programs, and read them in napari."""
