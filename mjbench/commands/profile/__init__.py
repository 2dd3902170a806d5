"""Where the time of a step goes, and what habits of a Python loop cost."""
