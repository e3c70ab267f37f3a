"""Revisions of the tables for Alembic, one a schema version: SQLite and PostgreSQL alike."""
