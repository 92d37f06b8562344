"""The tests. Code that several of them use is in `shared`."""
