"""The user's own program: where its time goes."""
