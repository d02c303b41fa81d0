"""What slopes say beyond themselves: height, curvature, roughness, other lights, shadows."""
