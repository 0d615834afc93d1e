"""Streams and files that OpenCV's FFmpeg opens by URL, read by a process each, judged by their pictures."""
