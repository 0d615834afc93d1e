"""The core: pairing, detectors, judge, faults, and the wiring between them."""
