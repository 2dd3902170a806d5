"""What a check-up is about and what it finds: its target, its parts, and what is combined."""
