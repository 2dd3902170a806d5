"""How long ticks of a controller take, and which are late."""
