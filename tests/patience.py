"""The time limit of everything that a test waits for.

A test waits for a condition, never for a time. The condition becomes true on any machine sooner or later. The limit
only ends a test that would hang, and is as generous as the limit of a whole test allows.
"""

PATIENCE_S = 600.0
