"""A long time limit (s) for everything that a test waits for; only a test that hangs reaches it."""

PATIENCE_S = 600.0
