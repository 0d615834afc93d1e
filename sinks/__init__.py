"""Where verdicts go, one file or folder a kind."""
