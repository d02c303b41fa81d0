"""Height, curvature, roughness, shadows and relit images from a gradient field."""
