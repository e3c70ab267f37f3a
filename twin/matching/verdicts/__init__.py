"""From pairs and gaps to verdicts, each with its reason."""
