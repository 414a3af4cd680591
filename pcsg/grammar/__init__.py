"""From text to graph: preprocessor, syntax, checks, lowering."""
