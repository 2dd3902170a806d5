"""What is measured: a `Measurement` for each command, and functions for `import mjbench`.

The functions return what the commands print. They print nothing, write no file unless asked to, and
leave no process behind.
"""
