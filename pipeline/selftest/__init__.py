"""Proof, on the owner's own footage, that the offset detector can be believed there."""
