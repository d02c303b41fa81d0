"""Height, curvature, roughness, cast shadows and relit images from a gradient field."""
