"""The page of the ``--json`` documents, and the schemas for programs."""

from __future__ import annotations

import json
from typing import Any

from reference.json_shapes import schemas
from reference.markdown import code, page, table

SCHEMAS = "json.schema.json"
_SCALARS = {
    "string": "text",
    "integer": "whole number",
    "number": "number",
    "boolean": "true or false",
    "null": "null",
}
_CONTAINERS = {"array": "list", "object": "table"}


def json_page() -> str:
    """Return docs/reference/json.md."""
    found, parts = schemas()
    rows = [[code(f"twin {command} --json"), _kind(shape)] for command, shape in found.items()]
    types = [
        "\n\n".join(
            [f"## {name}", part.get("description", ""), _keys(part) if "properties" in part else _kind(part)]
        ).replace("\n\n\n\n", "\n\n")
        for name, part in sorted(parts.items())
    ]
    return page(
        "JSON: what --json prints",
        "With `--json` a command prints one document on stdout and nothing else; messages go to stderr, a"
        " line of JSON each. A command that fails prints no document, but there an"
        " [ErrorMessage](#errormessage)."
        " A later version may add keys, so read past those that you do not know."
        f" [{SCHEMAS}]({SCHEMAS}) has the same as JSON schemas.",
        table(["command", "document"], rows),
        *types,
    )


def schema_document() -> str:
    """Return docs/reference/json.schema.json: a schema for each command, and the types that they share."""
    found, parts = schemas()
    commands = {f"twin {command}": shape for command, shape in found.items()}
    return (
        '{"$schema": "https://json-schema.org/draft/2020-12/schema",\n'
        '"title": "What twin prints under --json, by command",\n'
        f'"properties": {{\n{_lines(commands)}\n}},\n"$defs": {{\n{_lines(parts)}\n}}}}\n'
    )


def _lines(entries: dict[str, Any]) -> str:
    """A line for each entry: a change of one type is a change of one line."""
    return ",\n".join(
        f"{json.dumps(name)}: {json.dumps(one, ensure_ascii=False)}" for name, one in entries.items()
    )


def _keys(part: dict[str, Any]) -> str:
    rows = [
        [code(key), _kind(entry), entry.get("description", "")] for key, entry in part["properties"].items()
    ]
    return table(["key", "kind", "meaning"], rows)


def _kind(entry: dict[str, Any]) -> str:
    """A schema in words: ``list of text``, ``number or null``, a link to a type."""
    if "$ref" in entry:
        name = entry["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "anyOf" in entry:
        return " or ".join(_kind(one) for one in entry["anyOf"])
    if "enum" in entry:
        return "one of " + ", ".join(code(str(value)) for value in entry["enum"])
    kind = entry.get("type", "")
    inner = entry.get("additionalProperties" if kind == "object" else "items")
    if kind == "array" and not inner:
        inner = next(iter(entry.get("prefixItems", ())), None)
    if kind in _CONTAINERS:
        return (
            f"{_CONTAINERS[kind]} of {_kind(inner)}"
            if isinstance(inner, dict) and inner
            else _CONTAINERS[kind]
        )
    return _SCALARS.get(kind, "anything")
