"""Where frames come from, one file or folder a kind."""
