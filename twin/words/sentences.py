"""Sentences of reasons, in any language, with the names of signs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol, get_args

from twin.words import reasons as r
from twin.words.signs import NO_NAMES, SignNames, sign_title, sign_titles
from twin.words.table import Fact, Lang, say
from twin.words.titles import nvdb_type_title, verdict_title


class Reasoned(Protocol):
    """What has a reason: :class:`twin.store.records.Finding`."""

    @property
    def why(self) -> r.Why:
        """Its reason, as a kind with facts."""
        ...

    @property
    def reopened(self) -> r.Reopened | r.Told | None:
        """What was decided of it and has changed since."""
        ...


def reason_of(finding: Reasoned, lang: Lang = Lang.EN, names: SignNames = NO_NAMES) -> str:
    """Return a finding's reason; of one that is open again also what changed since it was decided."""
    told = sentence(finding.why, lang, names)
    return told if finding.reopened is None else f"{told} {sentence(finding.reopened, lang, names)}"


def sentence(why: r.Sayable, lang: Lang = Lang.EN, names: SignNames = NO_NAMES) -> str:
    """Make the sentence of a reason, or the clause of a misfit or a difference."""
    return _Sentences(lang, names).of(why)


_FAMILY = {
    **dict.fromkeys(get_args(r.Misfit), "misfit"),
    **dict.fromkeys(get_args(r.Difference), "changed"),
    **dict.fromkeys((*get_args(r.Why), *get_args(r.DriveDoubted)), "reason"),
    **dict.fromkeys((r.Temporary, r.NearTemporary, r.WorksOver), "cause"),
}
"""In which file of the table the messages of a kind stand, under the kind's name."""
KEYS = {kind: f"{family}.{kind.__struct_config__.tag}" for kind, family in _FAMILY.items()}
"""Kind → its message. A message names the kind's own fields as its facts."""


@dataclass(frozen=True, slots=True)
class _Sentences:
    """Sentences in one language."""

    lang: Lang
    names: SignNames

    def of(self, why: r.Sayable) -> str:
        """The sentence of any kind."""
        if isinstance(why, r.Told):
            return why.text
        if isinstance(why, r.Reopened):
            return self.reopened(why)
        facts = {name: self.fact(name, getattr(why, name)) for name in why.__struct_fields__}
        return say(self.lang, KEYS[type(why)], **facts, n=facts.get("n_drives", 0))

    def fact(self, name: str, value: object) -> Fact:
        """A field of a kind as it stands in a sentence."""
        if isinstance(value, float | int):
            return value
        if isinstance(value, str):
            return self.word(name, value)
        if isinstance(value, tuple):
            return self.several(name, value)
        if isinstance(value, r.SignSite):
            return self.site(value)
        if isinstance(value, r.Basis):
            return ", ".join(self.clauses(value))
        return say(self.lang, "changed.none") if value is None else self.of(value)  # type: ignore[arg-type]

    def word(self, name: str, value: str) -> str:
        """A text: a verdict, a sign code, or a name that somebody gave."""
        if name in {"verdict", "then", "now"}:
            return verdict_title(value, self.lang)
        if name == "at":
            return value[:10]
        if name in {"known", "seen", "code"}:
            return sign_title(value, self.names) if value else say(self.lang, "reason.without_code")
        return value

    def several(self, name: str, values: tuple[Any, ...]) -> str:
        """Codes of a pole, what drives read, codes of before and after, or misfits."""
        if name == "misfits":
            return "; ".join(map(self.of, values))
        if name == "readings":
            return ", ".join(values)
        if name == "codes":
            return sign_titles(values, self.names) or say(self.lang, "reason.code_not_annotated")
        return ";".join(values) or say(self.lang, "changed.none")

    def site(self, site: r.SignSite) -> str:
        """``Skiltpunkt 17 (202 – Vikeplikt)``."""
        codes = f" ({sign_titles(site.codes, self.names, between=', ')})" if site.codes else ""
        return f"{nvdb_type_title(site.nvdb_type)} {site.nvdb_id}{codes}"

    def clauses(self, basis: r.Basis) -> Iterator[str]:
        """What speaks for and against a pair."""
        if basis.sigmas is not None:
            yield say(self.lang, "basis.sigmas", sigmas=basis.sigmas)
        if basis.codes is not r.CodesAgree.NOT_IN_NVDB:
            yield say(self.lang, f"basis.codes_{basis.codes.value}", n=basis.n_codes)
        for text in basis.texts:
            yield say(self.lang, "basis.text", code=text.code, seen=text.seen, nvdb=text.nvdb)
        if basis.faces_away:
            yield say(self.lang, "basis.faces_away")
        if basis.same_side is not None:
            yield say(self.lang, "basis.same_side" if basis.same_side else "basis.other_side")
        yield say(self.lang, "basis.drives", n=basis.n_drives)

    def reopened(self, why: r.Reopened) -> str:
        """What was decided, by whom, with the comment; and what has changed."""
        by = f"{why.by} ({why.comment})" if why.comment else why.by
        changes = ", ".join(map(self.of, why.changes))
        return say(self.lang, f"reopened.{why.decision}", day=why.at[:10], by=by, changes=changes)
