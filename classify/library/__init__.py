"""Texture libraries: training, files, matching, evaluation."""
