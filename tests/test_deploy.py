"""The recipes of ``deploy/`` and the commands of their pages."""

from __future__ import annotations

import re
import shlex
from typing import Any

import pytest
import yaml
from checkout import ROOT
from typer.main import get_command

from twin.cli.app import app
from twin.cli.usage import UsageError

DEPLOY = ROOT / "deploy"
PAGES = tuple(ROOT / "docs" / name for name in ("install.md", "operations.md", "fleet.md"))
FLEET = DEPLOY / "fleet" / "compose.yaml"
# A program called twin, wherever it stands, and what follows it on its line.
CALL = re.compile(r"(?:^|[\s(/\\`-])twin(?:\.exe)? ((?:--?)?[a-z][^\n#&;|<>`)]*)", re.MULTILINE)

if not DEPLOY.is_dir():
    pytest.skip("the recipes are not beside the tests", allow_module_level=True)


def _commands() -> list[tuple[str, str]]:
    """File and arguments of each call of twin that somebody may copy."""
    found = []
    for path in sorted(path for path in DEPLOY.rglob("*") if path.is_file() and path.name != "Containerfile"):
        found += [(path.name, call) for call in CALL.findall(path.read_text("utf-8"))]
    services = yaml.safe_load(FLEET.read_text("utf-8"))["services"].values()
    found += [
        (FLEET.name, shlex.join(one["command"]))
        for one in services
        if "command" in one and "entrypoint" not in one
    ]
    for page in PAGES:
        blocks = re.findall(r"```\w*\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)
        found += [(page.name, call) for block in blocks for call in CALL.findall(block)]
    return found


@pytest.mark.parametrize(("file", "arguments"), _commands())
def test_a_recipes_command_can_be_given(file: str, arguments: str) -> None:
    """Its options and values are those of the program: it is parsed as the shell would hand it over."""
    command: Any = get_command(app)
    rest = shlex.split(arguments)
    if len(rest) == 1 and rest[0].startswith("-"):  # to parse it would do it
        assert rest[0] in {name for option in command.params for name in option.opts}
        return
    context: Any = None
    try:
        while True:
            context = command.make_context(command.name or "twin", rest, parent=context)
            if not hasattr(command, "get_command"):
                return
            name, *rest = [*context._protected_args, *context.args]
            command = command.get_command(context, name)
            assert command is not None, f"{file}: there is no twin {name}"
    except UsageError as error:
        pytest.fail(f"{file}: twin {arguments}: {error.format_message()}")


def test_every_recipe_calls_twin() -> None:
    """Whoever reads the commands above finds both of the night's in each recipe that runs at night."""
    for recipe in ("compose.yaml", "twin-nightly.service", "twin.cron", "twin-nightly.cmd"):
        words = [word for file, call in _commands() if file == recipe for word in call.split()]
        assert [word for word in words if word in {"sync-nvdb", "match"}][-2:] == ["sync-nvdb", "match"]


def test_the_container_copies_what_a_build_needs() -> None:
    """What pyproject.toml names for the wheel is there, and nothing that is not."""
    recipe = (DEPLOY / "Containerfile").read_text("utf-8")
    copied = re.findall(r"^COPY (?!--from)(.*) \S+$", recipe, re.MULTILINE)
    names = {name for line in copied for name in line.split()}
    assert all((ROOT / name).exists() for name in names)
    assert names == {"pyproject.toml", "README.md", "LICENSE", "data", "docs", "geoloc", "nvdb", "twin"}
