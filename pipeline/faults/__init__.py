"""Field failures, reproducible around any source: one file a kind."""
