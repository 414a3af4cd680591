"""Quad meshes of trees from line skeletons with radii."""
