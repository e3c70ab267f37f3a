"""What records of the store mean, in the words of the page's language."""

from __future__ import annotations

import datetime as dt

from twin.decisions.log import CARRIED, LIFTED, OPINION, REOPENED, SUPPRESSED, UNDONE, WITHDRAWN, Entry
from twin.evidence import Crop
from twin.words import Lang, SignNames, decision_title, say

_BY_GEOMETRY = "geometry"
_ENTRIES = {
    UNDONE: "review.entry.undone",
    WITHDRAWN: "review.entry.withdrawn",
    REOPENED: "review.entry.reopened",
    CARRIED: "review.entry.carried",
    OPINION: "review.entry.opinion",
    SUPPRESSED: "review.entry.by_twin",
    LIFTED: "review.entry.by_twin",
}


def entry_sentence(entry: Entry, lang: Lang, names: SignNames) -> str:
    """Tell one entry of the log."""
    return say(
        lang,
        _ENTRIES.get(entry.kind, "review.entry.decided"),
        by=entry.by,
        decision=decision_title(entry.decision, lang),
        why=f" – {entry.reason}" if entry.reason else "",
        told=entry.told(lang, names),
    )


def crop_caption(crop: Crop, lang: Lang) -> str:
    """Say which camera took a picture, from where and when."""
    day = day_of(crop.epoch_ns)
    return say(lang, "review.crop.caption", camera=crop.camera, range_m=crop.range_m, day=day)


def proof_sentence(crop: Crop, lang: Lang) -> str:
    """Say how people and vehicles in a picture were made unrecognisable."""
    if not crop.is_masked:
        return say(lang, "review.crop.unmasked")
    proof = crop.proof
    masker = say(lang, "review.crop.geometry") if proof.masker == _BY_GEOMETRY else proof.masker
    return say(lang, "review.crop.masked", share=proof.share_hidden + proof.share_softened, masker=masker)


def day_of(epoch_ns: int) -> dt.date:
    """Return the day of an epoch, UTC."""
    return dt.datetime.fromtimestamp(epoch_ns / 1e9, tz=dt.UTC).date()
