"""Which way of stepping is fastest, and whether all reach the same states."""
