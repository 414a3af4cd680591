"""Seeing a scene live: a page in a browser, served by a process that keeps scenes in others."""
