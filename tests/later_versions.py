"""A twin of a later version, for tests of upgrades."""

from __future__ import annotations

from pathlib import Path

import pytest

from twin.store import migrate, schema


def with_revisions(folder: Path, monkeypatch: pytest.MonkeyPatch, bodies: dict[int, str]) -> None:
    """Let twin be one that knows these revisions after its own."""
    (folder / "versions").mkdir(parents=True)
    (folder / "script.py.mako").touch()
    before = str(schema.VERSION)
    (folder / "versions" / "base.py").write_text(f"revision, down_revision = {before!r}, None\n")
    for number, body in ((str(one), body) for one, body in bodies.items()):
        text = f"import sqlalchemy as sa\nfrom alembic import op\n\nrevision = {number!r}\ndown_revision = "
        text += f"{before!r}\n\ndef upgrade():\n    {body}\n"
        (folder / "versions" / f"r{number}.py").write_text(text)
        before = number
    monkeypatch.setattr(migrate, "MIGRATIONS", folder)
    monkeypatch.setattr(schema, "VERSION", int(before))
