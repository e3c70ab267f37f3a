"""What stands in quotes below the fields of a class."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise
from textwrap import dedent


def written_below(kind: type) -> dict[str, str]:
    """Return field → the text below it; fields without one are left out."""
    (node,) = ast.parse(dedent(inspect.getsource(kind))).body
    found: dict[str, str] = {}
    for field, text in pairwise(node.body if isinstance(node, ast.ClassDef) else []):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            match text:
                case ast.Expr(value=ast.Constant(value=str(words))):
                    found[field.target.id] = " ".join(words.split()).replace("``", "`")
    return found
