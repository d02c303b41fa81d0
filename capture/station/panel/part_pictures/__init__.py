"""Pictures of stored parts, with what judged them."""
