"""The life of a recipe: settings, approval, roll back, and what it lacks."""
