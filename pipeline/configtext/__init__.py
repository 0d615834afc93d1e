"""Turns configuration text into plain data with remembered places, and problems into lines for people."""
