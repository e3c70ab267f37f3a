"""What people read, in English and Norwegian: one table of messages, names of signs, sentences of findings.

>>> say(Lang.NB, "seen.cameras", n=2)
'to kameraer'

The texts stand in ``messages/*.toml``, for a translator to edit; ``docs/words.md`` says how.
"""

from twin.words.gaps import WhyNoPicture, gap_from_json, gap_sentence, gap_to_json
from twin.words.reasons import Told, Why, why_from_json, why_to_json
from twin.words.seen import position_sentence, seen_sentence
from twin.words.sentences import reason_of, sentence
from twin.words.signs import NO_NAMES, SignNames, name_in, sign_title, sign_titles
from twin.words.table import Lang, language_from, messages, number_text, say
from twin.words.terms import Term, chance_text, terms_in_words
from twin.words.titles import decision_title, nvdb_type_title, verdict_title

__all__ = [
    "NO_NAMES",
    "Lang",
    "SignNames",
    "Term",
    "Told",
    "Why",
    "WhyNoPicture",
    "chance_text",
    "decision_title",
    "gap_from_json",
    "gap_sentence",
    "gap_to_json",
    "language_from",
    "messages",
    "name_in",
    "number_text",
    "nvdb_type_title",
    "position_sentence",
    "reason_of",
    "say",
    "seen_sentence",
    "sentence",
    "sign_title",
    "sign_titles",
    "terms_in_words",
    "verdict_title",
    "why_from_json",
    "why_to_json",
]
