"""Recordings as a source, one file a recording format."""
