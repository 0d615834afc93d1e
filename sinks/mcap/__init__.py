"""Records frames, verdicts, events and status into an MCAP file."""
