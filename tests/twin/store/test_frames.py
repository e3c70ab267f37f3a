"""Tables of a store as GeoDataFrames: what a researcher gets, and in which units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sqlalchemy as sa
from checkout import ROOT

import twin
from geoloc.earth.geodesy import geographic_from_utm33, grid_convergence_deg
from twin.decisions.findings import latest_findings
from twin.decisions.record import decide
from twin.errors import ConfigError, StoreError
from twin.store import schema
from twin.store.frames import COLUMNS
from twin.store.store import Store


def test_tables_have_the_columns_that_are_documented(opened: Store) -> None:
    """In their order, the geometry last, in EPSG:25833; docs/python.md says the same of each."""
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    for name, columns in COLUMNS.items():
        frame = getattr(opened, name)()
        assert len(frame)
        assert [*columns, "geometry"] == list(frame.columns)
        assert frame.crs.to_epsg() == 25833
        section = page.split(f"### `{name}`")[1].split("###")[0]
        assert [line for line in section.splitlines() if line.startswith("| `")] == [
            f"| `{column}` | {what} |" for column, what in columns.items()
        ]


def test_estimates_carry_the_covariance_of_the_store(opened: Store) -> None:
    """Sigmas and correlation, and the ellipse, each give back the covariance that the store keeps."""
    rows = {row["estimate_id"]: row for row in opened.rows(sa.select(schema.estimate))}
    frame = opened.estimates()
    assert set(frame["estimate_id"]) == set(rows)
    lat, lon = geographic_from_utm33(frame.geometry.x.to_numpy(), frame.geometry.y.to_numpy())
    turn = np.radians(frame["sigma_azimuth_deg"] - grid_convergence_deg(lat, lon))
    for k, one in frame.iterrows():
        row = rows[one["estimate_id"]]
        assert (one.geometry.x, one.geometry.y) == (row["east_m"], row["north_m"])
        assert one["sigma_east_m"] ** 2 == pytest.approx(row["cov_ee_m2"])
        both = one["correlation"] * one["sigma_east_m"] * one["sigma_north_m"]
        assert both == pytest.approx(row["cov_en_m2"])
        axis = np.array([np.sin(turn[k]), np.cos(turn[k])])
        other = np.array([axis[1], -axis[0]])
        covariance = one["sigma_major_m"] ** 2 * np.outer(axis, axis)
        covariance += one["sigma_minor_m"] ** 2 * np.outer(other, other)
        kept = [[row["cov_ee_m2"], row["cov_en_m2"]], [row["cov_en_m2"], row["cov_nn_m2"]]]
        assert covariance == pytest.approx(np.array(kept), rel=1e-6, abs=1e-12)
    assert set(opened.estimates("paper")["method"]) == {"paper"}
    # The paper's method gives no height: the car's is not the sign's.
    assert frame["height_m"].isna().equals(frame["method"] == "paper")
    assert frame["sigma_height_m"].notna().equals(frame["method"] == "adjusted")
    with pytest.raises(ConfigError, match="no method 'best': choose one of adjusted, single-frame, paper"):
        opened.estimates("best")


def test_sightings_without_a_position_have_no_geometry(opened: Store) -> None:
    """One row a sighting; the adjustment's have residuals, and what gives no position alone has no point."""
    frame = opened.sightings("adjusted")
    rows = opened.rows(sa.select(schema.sighting).where(schema.sighting.c.method == "adjusted"))
    assert len(frame) == len(rows)
    assert frame.geometry.isna().tolist() == [row["east_m"] is None for row in rows]
    assert frame.loc[frame["rejected"] == "", "residual_u_px"].notna().all()
    assert frame["rejected"].tolist() == [row["rejected"] for row in rows]
    single = opened.sightings("single-frame")
    # Outliers among positions of one picture are not marked: nothing says that one took part.
    assert single["rejected"].isna().equals(~single.geometry.isna())
    assert frame["time"].astype("int64").tolist() == [row["epoch_ns"] for row in rows]


def test_findings_carry_what_people_decided(opened: Store) -> None:
    """A decision shows with its name and time; the others are open; findings that are stale are refused."""
    first = next(one for one in latest_findings(opened.rows) if one.is_open)
    decide(opened, [first.change_id], "accept", by="kari")
    frame = opened.findings().set_index("change_id")
    assert frame.loc[first.change_id, ["decision", "decided_by"]].tolist() == ["accept", "kari"]
    assert frame["decided_at"].notna().sum() == 1
    assert frame.loc[first.change_id, "reason"] == first.finding.reason
    missing = frame[frame["verdict"] == "missing"]
    assert missing["sigma_major_m"].isna().all()
    assert not missing.geometry.isna().any()


def test_a_store_is_opened_and_never_made(store: Path, tmp_path: Path) -> None:
    """`twin.Store(path)` reads; of a name that is mistaken it says so, and makes no file."""
    with twin.Store(str(store)) as opened:
        assert len(opened.drives()) == 1
        assert opened.drives()["methods"].tolist() == ["adjusted,paper,single-frame"]
    with pytest.raises(StoreError, match="There is no store at"):
        twin.Store(tmp_path / "mistaken.db")
    assert not (tmp_path / "mistaken.db").exists()
