"""What the car measured of its own motion: speed of its wheels, rate of turn, angle of its front wheels."""
