"""The time limit of everything that a test waits for.

A test waits for a condition, never for a time. On any machine the condition becomes true sooner or later. The limit
ends only a test that would hang. It is nearly as long as the limit of a whole test.
"""

PATIENCE_S = 600.0
