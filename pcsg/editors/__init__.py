"""For editors: words by kind, highlighting, and the language server."""
