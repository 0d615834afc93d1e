"""Recordings as MCAP files that Foxglove opens and our own replay reads back."""
