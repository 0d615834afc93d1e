"""`audit`: finds the recordings of an archive and judges them, many at a time, here or on a cluster."""
