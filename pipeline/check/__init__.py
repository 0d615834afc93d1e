"""`check`: headers of a whole recording first, then pictures where it matters, until the answer is sure."""
