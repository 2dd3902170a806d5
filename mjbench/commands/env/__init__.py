"""Where the time of `env.step` goes."""
