"""The skeleton of self-contained HTML pages: maps, calibration, session, studies."""
