"""The cyclic CSG graph: nodes, expressions, analyses and states."""
