"""What in the source of a program costs time or gives wrong results."""
