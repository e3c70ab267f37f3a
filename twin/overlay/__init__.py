"""What is known, drawn over a drive's own pictures: clicks, estimates, NVDB's signs, distances, horizon."""
