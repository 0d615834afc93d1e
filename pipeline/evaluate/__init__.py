"""Runs recordings, manipulated in known ways, against the truth, and says how often the product was right."""
