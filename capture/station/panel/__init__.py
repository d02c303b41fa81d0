"""The station's web application: pages and HTTP API."""
