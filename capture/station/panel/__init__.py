"""The station's web application: pages, HTTP API and what all faces of a station see of it."""
