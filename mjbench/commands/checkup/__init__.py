"""What to change first in a model, a program or an environment."""
