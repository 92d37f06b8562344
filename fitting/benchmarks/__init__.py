"""Speed, accuracy and what they are against FElupe, printed: `python -m benchmarks.speed`, `.mesh`, `.peer`."""
