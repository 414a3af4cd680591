"""Geometry that every floor above needs: bounding volume hierarchies."""
