"""What all solvers share: samples, rests, noise, alignment, least squares; no method of its own."""
