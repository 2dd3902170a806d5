"""One folder a command: its options, what it measures, what it means, what it shows."""
