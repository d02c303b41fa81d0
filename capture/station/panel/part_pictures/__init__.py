"""Pictures of stored parts, and the recipe, solver and defect model that judged them."""
