"""One file a way of finding out whether two frames were taken together."""
