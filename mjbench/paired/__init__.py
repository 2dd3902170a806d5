"""Two targets, timed in alternating blocks, until a verdict is certain."""
