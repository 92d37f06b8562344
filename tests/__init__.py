"""The tests. The folder `shared` contains code that several tests use."""
