"""The time limit of everything for which a test waits.

A test waits for a condition, never for a time. On any computer the condition becomes true sooner or later, so that the
limit ends only a test that would never end. The limit is nearly as long as the limit of a whole test.
"""

PATIENCE_S = 600.0
