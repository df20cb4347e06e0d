"""The way to a daemon: sessions, calls, arrays, shared memory, GPUs."""
