"""MuJoCo releases: which exist, how they are installed, what their history shows."""
