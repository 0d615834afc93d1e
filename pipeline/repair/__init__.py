"""Writes a recording anew, with the frames together that belong together."""
