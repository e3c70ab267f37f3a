"""Many drives past the same poles → one position a pole, with what each drive shares estimated as such."""
