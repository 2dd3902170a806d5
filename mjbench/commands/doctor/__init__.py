"""How far this machine can be trusted."""
