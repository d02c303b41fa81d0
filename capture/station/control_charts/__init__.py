"""Control charts of LED levels and distances."""
