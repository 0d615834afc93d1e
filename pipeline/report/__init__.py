"""The report on one recording: one HTML page that needs nothing else, and its numbers."""
