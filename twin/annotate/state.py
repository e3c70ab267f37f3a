"""All signs as the page lists them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin.annotate.marks import Page, Sign
from twin.annotate.proposals import Placed
from twin.annotate.records import OfferItem, SignItem
from twin.drives.drive import Annotations
from twin.words import SignNames, sign_titles


def signs_of(
    page: Page, placed: Mapping[str, Placed], foreign: Annotations, names: SignNames
) -> list[SignItem]:
    """List the page's signs, then those that other tools marked and the page did not."""
    marked: dict[str, dict[str, list[int]]] = {}
    counts: dict[str, list[int]] = {}
    for where, mark in page.marks.items():
        marked.setdefault(where.object, {}).setdefault(where.camera, []).append(where.frame)
        counts.setdefault(where.object, [0, 0])[not mark.is_measured] += 1
    foreign_codes: dict[str, str] = {}
    for k, name in enumerate(foreign.object.tolist()):
        marked.setdefault(name, {}).setdefault(str(foreign.camera[k]), []).append(int(foreign.frame[k]))
        if name not in page.signs:
            counts.setdefault(name, [0, 0])[not foreign.is_measured[k]] += 1
            foreign_codes[name] = str(foreign.skiltnummer[k]) or foreign_codes.get(name, "")
    signs = {**page.signs, **{name: Sign(codes) for name, codes in sorted(foreign_codes.items())}}
    return [
        _item(
            name, sign, counts[name], marked[name], placed.get(name), names, is_foreign=name in foreign_codes
        )
        for name, sign in signs.items()
    ]


def _item(
    name: str,
    sign: Sign,
    count: list[int],
    marked: dict[str, list[int]],
    placed: Placed | None,
    names: SignNames,
    *,
    is_foreign: bool,
) -> SignItem:
    misses = [] if placed is None else [float(np.hypot(*miss)) for miss in placed.misses.values()]
    sigma_m = None if placed is None or np.isnan(placed.place.sigma_m) else placed.place.sigma_m
    return SignItem(
        object=name,
        codes=sign.codes,
        title=sign_titles(filter(None, sign.codes.split(";")), names),
        by=sign.by,
        n_clicks=count[0],
        n_seen=count[1],
        sigma_m=sigma_m,
        worst_px=max(misses, default=None),
        in_view={} if placed is None else {c: seen.frame.tolist() for c, seen in placed.seen.items()},
        marked={camera: sorted(set(frames)) for camera, frames in marked.items()},
        offers=[] if placed is None else [OfferItem(*offer) for offer in placed.offers],
        is_foreign=is_foreign,
    )
