"""Measures from pictures alone how far apart in time two cameras are, in hundredths of a frame."""
