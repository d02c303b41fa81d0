"""The results of a station: one row a part in a database, never changed."""
