"""Growing trees: any age of a tree, computed directly."""
