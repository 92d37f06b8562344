"""The tests. Code that several tests use is in `shared`."""
