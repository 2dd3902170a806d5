"""What is measured. Benchmarks declare; mjbench measures."""
