"""Bounding volume hierarchies: the compiled builder."""
