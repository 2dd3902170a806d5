"""Instructions instead of seconds: counted by Callgrind, and explained by function."""
