"""The time limit of everything for which a test waits; it ends only a test that would never end."""

PATIENCE_S = 600.0
