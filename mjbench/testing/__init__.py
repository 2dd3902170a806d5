"""The pytest fixture `mjbench`: a test fails when a function is certainly slower than another."""
