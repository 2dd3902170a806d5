"""What runs inside the user's program; it needs Python's standard library alone."""
