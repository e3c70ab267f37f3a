"""Where the car was: fixes of receivers or poses, from any logger."""
