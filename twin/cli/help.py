"""``twin help``: the pages of the documentation, from a wheel as well as from a checkout."""

from __future__ import annotations

import re
import sys
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer

from twin.cli.output import console, note, print_table

app = typer.Typer()
_PACKAGE = Path(__file__).parents[1]
_ROOTS = (_PACKAGE / "pages", _PACKAGE.parent / "docs")
"""Package data of a wheel, or the folder of a source tree."""
_FOLDERS = {"tutorials": "Start here", "": "Pages", "reference": "Reference"}
"""Folder of pages → how the list calls it."""
_ALSO = {"units": "conventions", "sigma": "conventions", "sigmas": "conventions"}
"""What people look for → the page that has it."""
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?:[\w.-]+/)*([\w-]+)\.md(?:#[^)\s]*)?\)")


@app.command("help", epilog="Example: twin help drive-folder")
def help_(
    context: typer.Context,
    topic: Annotated[
        list[str] | None,
        typer.Argument(help="A page or a command.  [default: list the pages]", show_default=False),
    ] = None,
) -> None:
    """Read the documentation: a page, a command's options, or the list of pages."""
    from twin.cli import run

    words, pages, group = topic or [], help_pages(), context.find_root().command
    name = " ".join(words).lower().removesuffix(".md")
    is_command = name in command_names(group)
    name = _ALSO.get(name, name)
    if not name:
        _list(pages)
    elif name in pages:
        _show(pages[name], pages)
        if is_command:
            note(f"The options of the command: twin {name} --help")
    elif is_command:
        run([*name.split(), "--help"])
    else:
        _refuse(name, [*pages, *command_names(group)], pages)


def help_pages() -> dict[str, Path]:
    """Return topic → page, in the order of the list.

    Raises
    ------
    TwinError
        The installation lacks the pages.
    """
    from twin.errors import TwinError

    for root in _ROOTS:
        if (root / "drive-folder.md").is_file():
            found = (page for folder in _FOLDERS for page in sorted((root / folder).glob("*.md")))
            return {page.stem: page for page in found if page.stem != "index"}
    raise TwinError("This installation lacks its pages: install the wheel, or work in the source tree.")


def command_names(group: Any) -> list[str]:
    """Return the names of all commands; those of a group follow its own: calibrate, calibrate verify."""
    names = []
    for name in group.list_commands(None):
        command = group.get_command(None, name)
        subs = command_names(command) if hasattr(command, "list_commands") else []
        names += [name, *(f"{name} {sub}" for sub in subs)]
    return names


def _list(pages: dict[str, Path]) -> None:
    for folder, title in _FOLDERS.items():
        # What lies in neither folder lies in the root, whatever that is called.
        rows = [
            (topic, _title(page))
            for topic, page in pages.items()
            if (page.parent.name if page.parent.name in _FOLDERS else "") == folder
        ]
        if rows:
            print_table(title, ["", ""], rows, header=False, right_from=2)
    note("A page: twin help TOPIC. Plain Markdown on a pipe: twin help TOPIC | less")


def _title(page: Path) -> str:
    return page.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")


def _show(page: Path, pages: dict[str, Path]) -> None:
    """Print a page: laid out on a terminal, as it is on a pipe."""
    text, terminal = page.read_text(encoding="utf-8"), console()
    if not terminal.is_terminal:
        sys.stdout.write(text)
        return
    from rich.markdown import Markdown

    def told(link: re.Match[str]) -> str:
        # A terminal cannot follow a link to a file: the command that shows it can be typed.
        return f"{link[1]} (`twin help {link[2]}`)" if link[2] in pages else link[1]

    terminal.print(Markdown(_LINK.sub(told, text)))


def _telling(word: str, pages: dict[str, Path]) -> list[str]:
    """Pages that say something of a word: first those with it in a heading, then by how often it stands."""
    found: dict[str, tuple[int, int]] = {}
    for topic, page in pages.items():
        lines = page.read_text(encoding="utf-8").casefold().splitlines()
        headings = sum(word in line for line in lines if line.startswith("#"))
        if n := sum(line.count(word) for line in lines):
            found[topic] = (headings, n)
    return sorted(found, key=lambda topic: found[topic], reverse=True)


def _refuse(name: str, names: list[str], pages: dict[str, Path]) -> None:
    from twin.errors import ConfigError

    called = [*(one for one in names if name in one), *get_close_matches(name, names)]
    near = dict.fromkeys(called or _telling(name, pages))
    perhaps = f" (perhaps {', '.join(list(near)[:4])})" if near else ""
    raise ConfigError(f"There is no topic {name!r}{perhaps}: `twin help` lists them.")
