"""Whether NVDB knows an area, asked before anything is mirrored of it."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Final

from nvdb.area import Area
from nvdb.client import NvdbClient
from nvdb.errors import AreaError, BodyError, HttpStatusError

_MAX_NAMED: Final = 3
_LISTS: Final = {"kommune": "/omrader/kommuner", "fylke": "/omrader/fylker"}


def refuse_unknown(client: NvdbClient, area: Area) -> None:
    """Ask API Les V4 for its kommuner or fylker, and refuse an area that is not among them.

    The list is asked for because numbers change with each reform. Where the API has none to give, nothing is
    refused; kontraktsområder, boxes and the whole country are not looked up.

    Raises
    ------
    AreaError
        NVDB has no such kommune or fylke; the message names the nearest numbers.
    TransportError
        The API cannot be reached.
    """
    kind, numbers = ("kommune", area.kommuner) if area.kommuner else ("fylke", area.fylker)
    if not numbers:
        return
    known = _known(client, kind)
    unknown = [number for number in numbers if known and number not in known]
    if not unknown:
        return
    digits = 4 if kind == "kommune" else 2
    names = {f"{number:0{digits}d}": name for number, name in known.items()}
    wrong = f"{unknown[0]:0{digits}d}"
    near = get_close_matches(wrong, names, n=_MAX_NAMED, cutoff=0.5)
    perhaps = f" (perhaps {', '.join(f'{one} {names[one]}'.strip() for one in near)})" if near else ""
    raise AreaError(f"NVDB has no {kind} {wrong}{perhaps}: give a number that is in use today.")


def _known(client: NvdbClient, kind: str) -> dict[int, str]:
    """Number → name of all areas of a kind; empty where the API does not say."""
    try:
        answer = client.get_json(_LISTS[kind])
    except (HttpStatusError, BodyError):
        return {}
    known = {}
    for item in answer if isinstance(answer, list) else []:
        number = item.get("nummer") if isinstance(item, dict) else None
        if isinstance(number, int) and not isinstance(number, bool):
            known[number] = str(item.get("navn") or "")
    return known
