"""What the twin keeps: one SQLite file, its tables, its snapshots, and files that are whole or not there."""
