"""Drives with known truth: road, motion, noise, car and scenarios."""
