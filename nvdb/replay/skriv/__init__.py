"""API Skriv on loopback: takes, checks and carries out change sets as NVDB does."""
