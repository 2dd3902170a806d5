"""Which settings make a model faster, and what they cost in accuracy."""
