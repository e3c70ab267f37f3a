"""``twin drives --cost``: what drives cost, by the user's own figures."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from twin.cli.output import note, print_table

if TYPE_CHECKING:
    from twin.reports.cost import Rates
    from twin.reports.drive_list import DriveItem

CostOption = Annotated[
    bool, typer.Option("--cost", help="What each drive cost, by your own figures: the three options below.")
]
CostPerKmOption = Annotated[
    float | None,
    typer.Option(min=0.0, envvar="TWIN_COST_PER_KM", help="Money for a kilometre driven.", metavar="MONEY"),
]
CostPerHourOption = Annotated[
    float | None,
    typer.Option(
        min=0.0, envvar="TWIN_COST_PER_HOUR", help="Money for an hour of annotation.", metavar="MONEY"
    ),
]
SecondsPerMarkOption = Annotated[
    float | None,
    typer.Option(
        min=0.0,
        envvar="TWIN_SECONDS_PER_MARK",
        help="An annotator's time for a point or box, looking included.",
        metavar="SECONDS",
    ),
]


_KEYS = ("cost_per_km", "cost_per_hour", "seconds_per_mark")


def print_cost(items: list[DriveItem], rates: Rates) -> None:
    """Print what each drive cost, and all together."""
    from twin.reports.cost import cost_of

    named = [(item.name, cost_of([item], rates)) for item in items]
    if len(items) > 1:
        named.append(("all", cost_of(items, rates)))
    print_table(
        "Cost",
        ["drive", "km driven", "marks", "hours", "driving", "annotation", "together", "a km"],
        [
            (
                *(name, one.length_km, one.n_marks, one.hours, one.driving, one.annotating),
                *(one.total, one.per_km),
            )
            for name, one in named
        ],
    )
    note("Kilometres and marks are measured; hours and money are these times your own figures.")
    lacking = [key for key, value in zip(_KEYS, asdict(rates).values(), strict=True) if value is None]
    if lacking:
        note(f"Not given: {', '.join(lacking)}. Set them in twin.toml, or as options.")
