"""Parts of the joint adjustment: scene, start, unknowns, model, solution (see :mod:`geoloc.adjust`)."""
