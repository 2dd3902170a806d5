"""Start states, controls and steps recorded in a program of the user."""
