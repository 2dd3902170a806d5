"""Timed rounds, and the statistics of what they give."""
