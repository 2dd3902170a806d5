"""Run files: records, how they are written, read, continued and set beside each other."""
