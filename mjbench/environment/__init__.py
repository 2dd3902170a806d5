"""Environments of reinforcement learning: where the time of their step goes."""
