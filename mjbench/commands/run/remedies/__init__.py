"""What to do about a program, and what that saves: rows of tables, one for each remedy."""
