"""Studies of the product: commands that print a table beside its limits."""
