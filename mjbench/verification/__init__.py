"""Do all ways of stepping a model reach the same states: plans, reference cases, checks."""
