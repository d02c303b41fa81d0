"""Recipes in the panel: pages, calls, settings, and jobs of teaching and challenge."""
