"""Where the cameras sit on the car, from pictures of tags in a yard."""
