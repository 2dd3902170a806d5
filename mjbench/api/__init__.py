"""What a program measures by `import mjbench`: functions that return what the commands print.

They print nothing, write no file unless asked to, and leave no process behind.
"""
