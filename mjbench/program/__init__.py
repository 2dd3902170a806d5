"""The user's own program: what runs around the engine in it, and what the same physics costs."""
