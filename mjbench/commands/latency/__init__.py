"""How long single steps take, and which are late."""
