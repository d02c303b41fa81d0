"""From a captured set to measures and the verdict."""
