"""MuJoCo's WebAssembly builds beside C of the same release: agreement, speed, start-up, memory."""
