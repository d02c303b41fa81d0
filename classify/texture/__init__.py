"""Texture features: spectra, local statistics and headings of slopes and albedo."""
