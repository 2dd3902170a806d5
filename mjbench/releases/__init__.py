"""MuJoCo releases: which exist, and how they are installed."""
