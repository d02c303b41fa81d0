"""The report of a session: figures of the capture and of the textures."""
