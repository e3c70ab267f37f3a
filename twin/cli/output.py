"""How commands talk: data on stdout (tables or JSON), progress and messages on stderr."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from typing import TYPE_CHECKING, Any

from twin.cli.journal import manner, say

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.console import Console
    from rich.progress import Progress, Task


def console(*, stderr: bool = False) -> Console:
    """Return a rich console; made when needed, since importing rich costs start-up time."""
    from rich.console import Console

    terminal = Console(stderr=stderr, highlight=False)
    if not terminal.is_terminal:
        # A pipe has no width: nothing is to be cut to the 80 columns that rich assumes.
        terminal.width = 200
    return terminal


def error_line(text: str, code: int) -> None:
    """Say on stderr why the command ends with an exit code other than 0."""
    say("error", text, code=code)


def note(text: str) -> None:
    """Print one line of advice on stderr; not with ``--quiet``."""
    say("note", text)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    say("warning", text)


def _escape(text: str) -> str:
    from rich.markup import escape

    return escape(text)


def print_json(value: Any) -> None:
    """Print one JSON document on stdout."""
    plain = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
    text = json.dumps(plain, ensure_ascii=False, indent=2, default=str)
    # A file's name may be no text at all, on any stream.
    sys.stdout.write(text.encode("utf-8", errors="replace").decode() + "\n")


def print_table(
    title: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[object]],
    *,
    right_from: int = 1,
    header: bool = True,
) -> None:
    """Print a table on stdout; columns from `right_from` on are aligned to the right."""
    from rich.table import Table

    table = Table(title=_escape(title), title_justify="left", title_style="bold", show_header=header)
    table.header_style = "bold"
    for number, name in enumerate(columns):
        table.add_column(_escape(name), justify="right" if number >= right_from else "left", overflow="fold")
    for row in rows:
        table.add_row(*(_escape(cell(value)) for value in row))
    console().print(table)


def cell(value: object) -> str:
    """Format one value: two decimals for numbers with a fraction, a dash for none."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.2f}"
    if isinstance(value, int):
        return f"{value:,}"
    return str(value)


def print_paths(title: str, paths: Sequence[object]) -> None:
    """Print file names a line each on stdout, whole, for people to copy."""
    sys.stdout.write(f"{title}\n" + "".join(f"  {path}\n" for path in paths))


def print_line(text: str) -> None:
    """Print one line on stdout: what has changed, where ``--quiet`` leaves the tables out."""
    sys.stdout.write(f"{text}\n")


def print_pairs(title: str, pairs: Mapping[str, object]) -> None:
    """Print a table of two columns without a header."""
    print_table(title, ["", ""], [(key, value) for key, value in pairs.items()], header=False)


@contextmanager
def steps(*, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Give a function that shows what is being done now: a spinner where somebody watches.

    With ``--verbose`` each step is a line with the seconds since the start.
    """
    err = console(stderr=True)
    if quiet or manner.quiet or manner.verbose or not err.is_terminal:
        yield lambda text: say("step", text)
        return
    with err.status("…") as status:

        def show(text: str) -> None:
            say("step", text)
            status.update(_escape(text))

        yield show


@contextmanager
def bar(*, quiet: bool = False) -> Iterator[Callable[[str, int, int | None], None]]:
    """Give a function ``(what, done, total)`` that moves a progress bar with rate and time left.

    What is finished shows its mean rate and the time it took.
    """
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
    from rich.text import Text

    class _TimeLeft(TimeRemainingColumn):
        def render(self, task: Task) -> Text:
            shown = super().render(task)
            return shown if task.finished or not shown.plain.strip("-: ") else shown + Text(" left")

    err = console(stderr=True)
    if quiet or manner.quiet or manner.verbose or not err.is_terminal:
        yield lambda _what, _done, _total: None
        return
    texts = (TextColumn("{task.fields[count]}"), TextColumn("{task.fields[rate]}"))
    left = _TimeLeft(elapsed_when_finished=True)
    with Progress(TextColumn("{task.description}"), BarColumn(), *texts, left, console=err) as progress:
        bars = _Bars(progress)
        try:
            yield bars.show
        finally:
            bars.finish()


class _Bars:
    """One line of a progress display for each thing that is being done."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._lines: dict[str, Task] = {}

    def show(self, what: str, done: int, total: int | None) -> None:
        count = f"{done:,}" if total is None else f"{done:,} of {total:,}"
        if what not in self._lines:
            self.finish()
            number = self._progress.add_task(what, completed=done, total=total, count=count, rate="")
            line = next(task for task in self._progress.tasks if task.id == number)
            line.fields["first"] = done
            self._lines[what] = line
        line = self._lines[what]
        self._progress.update(line.id, completed=done, total=total, count=count)
        # What an interrupted run had fetched before says nothing of this run's rate.
        fetched, elapsed_s = done - line.fields["first"], line.finished_time or line.elapsed
        if fetched and elapsed_s:
            self._progress.update(line.id, rate=f"{fetched / elapsed_s:,.0f}/s")

    def finish(self) -> None:
        """End what has no known total, whose bar would go on moving."""
        for line in self._lines.values():
            if line.total is None:
                self._progress.update(line.id, total=line.completed)
