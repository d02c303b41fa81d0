"""The report of a session: what its sets say about the capture and about the textures."""
