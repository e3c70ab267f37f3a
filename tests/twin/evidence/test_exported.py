"""Pictures that an export takes along: masked ones, whole, and no others."""

from __future__ import annotations

import datetime as dt
import hashlib
from pathlib import Path
from typing import Any

import pyogrio

from twin.evidence import crop_file, crops_of, exportable_crops, forget, make_evidence
from twin.evidence.crops import Role
from twin.export import export_findings
from twin.export.folder import UTM33
from twin.store.store import Store


def _named(out: Path) -> dict[str, tuple[str, str]]:
    """change_id → the paths that the layer names, of findings with pictures."""
    frame = pyogrio.read_dataframe(out / UTM33, layer="changes")
    rows = frame[(frame["crop_face"] != "") | (frame["crop_wide"] != "")]
    return {row.change_id: (row.crop_face, row.crop_wide) for row in rows.itertuples()}


def _files(out: Path) -> dict[str, bytes]:
    return {path.relative_to(out).as_posix(): path.read_bytes() for path in (out / "crops").glob("*")}


def test_export_takes_the_best_view_of_each_finding_along(made: Any, tmp_path: Path) -> None:
    """Under their hashes, as they are in the store; what an export before had and this one lacks goes."""
    out = tmp_path / "out"
    with Store.open(made.store) as store:
        export_findings(store, out)
        named, files = _named(out), _files(out)
        assert len(named) == 4
        for change_id, paths in named.items():
            best = {crop.role: f"crops/{crop.sha256}.webp" for crop in crops_of(store.rows, change_id)[:2]}
            assert paths == (best[Role.FACE], best[Role.WIDE])
        assert files.keys() == {path for paths in named.values() for path in paths}
        assert all(hashlib.sha256(b).hexdigest() == Path(path).stem for path, b in files.items())

        damaged = crop_file(store, Path(next(iter(named.values()))[0]).stem)
        damaged.write_bytes(b"not the picture")
        (out / "crops" / "mine.webp").write_bytes(b"a person's own file")
        export_findings(store, out)
        assert all(content != b"not the picture" for content in _files(out).values())

        forget(store, before=dt.datetime.now(dt.UTC))
        export_findings(store, out)
        assert (_named(out), _files(out)) == ({}, {"crops/mine.webp": b"a person's own file"})


def test_unmasked_pictures_never_leave_by_an_export(filmed: Any, tmp_path: Path) -> None:
    """Neither the file nor its name, also where a masked export was there before."""
    out = tmp_path / "out"
    filmed.only("45ca7449d96d")
    with Store.open(filmed.store) as store:
        make_evidence(store)
        export_findings(store, out)
        assert _named(out)
        make_evidence(store, unmasked_reason="court case", by="kari")
        assert exportable_crops(store.rows) == ()
        assert export_findings(store, out).n_unmasked == 6
        assert _named(out) == {}
        assert not (out / "crops").exists()
        # They count as missing where masked ones are wanted, and only there.
        assert make_evidence(store, missing_only=True, unmasked_reason="more", by="kari").n_findings == 0
        make_evidence(store, missing_only=True)
        assert export_findings(store, out).n_unmasked == 0
    assert _named(out)
