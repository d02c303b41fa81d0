"""Settings of a recipe, approval, roll back, and the reasons why a recipe cannot run."""
