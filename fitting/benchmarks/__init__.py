"""Speed and accuracy of the forward model, printed: `python -m benchmarks.speed`, `python -m benchmarks.mesh`."""
