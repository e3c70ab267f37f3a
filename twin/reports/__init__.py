"""What the store holds, for people: one estimate explained, errors against a truth, the state of all."""
