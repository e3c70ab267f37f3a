"""One sighting → position and covariance: the paper's method, the true ray, and the ray on a terrain."""
