"""Rays through graphs: packed tables and the kernels that walk them."""
