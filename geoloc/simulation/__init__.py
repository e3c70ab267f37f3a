"""Parts of the simulator: earth, road, motion, noise, car and scenarios (see :mod:`geoloc.simulate`)."""
