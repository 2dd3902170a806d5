"""A Python loop around `mj_step`: what it wastes, and how to record from it."""
