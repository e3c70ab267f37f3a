"""The picture for places without QGIS."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import shapely

from twin.errors import ConfigError, TwinError
from twin.export import ExportLayers, empty_layers, render_map
from twin.export.appearance import MARKS
from twin.export.picture.labels import place_labels
from twin.export.picture.map_frame import Window, frame_map
from twin.export.picture.road_names import draw_road_names


def _colours(path: Path) -> dict[str, int]:
    import cv2

    bgr = cv2.imread(str(path))
    assert bgr is not None
    values, counts = np.unique(bgr.reshape(-1, 3), axis=0, return_counts=True)
    return {f"#{r:02x}{g:02x}{b:02x}": int(n) for (b, g, r), n in zip(values, counts, strict=True)}


def test_picture_shows_every_verdict_in_its_colour(layers: ExportLayers, tmp_path: Path) -> None:
    """Each verdict fills at least a dozen pixels with the colour that QGIS uses."""
    colours = _colours(render_map(layers, tmp_path / "map.png", dpi=80))
    assert {mark.verdict: colours.get(mark.colour, 0) > 12 for mark in MARKS} == {
        mark.verdict: True for mark in MARKS
    }


def test_picture_of_the_same_data_is_the_same_bytes(layers: ExportLayers, tmp_path: Path) -> None:
    """No clock and no order of rows in the picture."""
    shuffled = dataclasses.replace(layers, changes=layers.changes[::-1])
    first = render_map(layers, tmp_path / "a.png", dpi=40).read_bytes()
    assert render_map(shuffled, tmp_path / "b.png", dpi=40).read_bytes() == first


@pytest.mark.parametrize("kept", ["nothing", "nvdb_signs", "drives", "changes", "estimates"])
def test_picture_is_drawn_from_whatever_is_there(layers: ExportLayers, tmp_path: Path, kept: str) -> None:
    """Any layer may be empty."""
    some = empty_layers()
    if kept != "nothing":
        some = dataclasses.replace(some, **{kept: getattr(layers, kept)})
    assert len(_colours(render_map(some, tmp_path / "map.png", dpi=40))) > 10


@pytest.mark.slow
def test_picture_lies_tall_roads_beside_their_close_ups(layers: ExportLayers, tmp_path: Path) -> None:
    """A road that runs north is drawn, too: the four close-ups stand beside it and show all colours."""
    turned = {}
    for name in ("changes", "estimates", "nvdb_signs", "drives"):
        frame = getattr(layers, name)
        turned[name] = frame.set_geometry(frame.rotate(90, origin=(270_000, 7_041_000)))
    colours = _colours(render_map(ExportLayers(**turned), tmp_path / "map.png", title="Northwards", dpi=80))
    assert all(colours.get(mark.colour, 0) > 12 for mark in MARKS)


@pytest.mark.slow
def test_picture_enlarges_an_ellipse_that_its_mark_hides(layers: ExportLayers, tmp_path: Path) -> None:
    """Ellipses of 5 cm by 2 cm would be a few pixels under the marks: the fill of one covers hundreds.

    The sign that was not seen has none: of the four close-ups three show one.
    """
    small = layers.estimates.assign(sigma_major_m=0.02, sigma_minor_m=0.01, cep95_m=0.05)
    drawn = _colours(render_map(dataclasses.replace(layers, estimates=small), tmp_path / "a.png", dpi=80))
    without = dataclasses.replace(layers, estimates=layers.estimates.iloc[:0])
    none = _colours(render_map(without, tmp_path / "b.png", dpi=80))
    # #1b2a41 at 34 of 255 over white.
    fill = [f"#{r:02x}{g:02x}{b:02x}" for r in (224, 225) for g in (226, 227) for b in (229, 230)]
    assert sum(drawn.get(colour, 0) for colour in fill) > 1000
    assert sum(none.get(colour, 0) for colour in fill) < 300


@pytest.mark.slow
def test_picture_leaves_an_ellipse_that_shows_where_it_is(layers: ExportLayers, tmp_path: Path) -> None:
    """One of several metres is wider than its mark: it is drawn once, to scale."""
    wide = dataclasses.replace(layers, estimates=layers.estimates.assign(sigma_major_m=1.0))
    narrow = dataclasses.replace(layers, estimates=layers.estimates.assign(sigma_major_m=0.02))
    white = {}
    for name, some in (("wide", wide), ("narrow", narrow)):
        colours = _colours(render_map(some, tmp_path / f"{name}.png", dpi=80))
        white[name] = colours.get("#ffffff", 0)
    # The enlarged squares are white, the map is not.
    assert white["narrow"] > white["wide"] + 5000


def test_map_names_each_road_once_between_its_signs(layers: ExportLayers) -> None:
    """A road's name lies on the driven line, turned like it, farther from every mark than half its gap."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    signs = layers.nvdb_signs.copy()
    line = shapely.LineString([(270_000, 7_041_000), (270_060, 7_041_060)])
    stations = [5.0, 15.0, 55.0, 80.0]
    kept = signs.iloc[: len(stations)].copy()
    kept["road_reference"] = [f"FV6680 S1D1 m{m:.0f}" for m in stations]
    kept = kept.set_geometry([line.interpolate(m) for m in stations], crs=signs.crs)
    drives = layers.drives.iloc[:1].set_geometry([line], crs=signs.crs)
    changes = layers.changes.iloc[:1].assign(road="FV6680 S1D1 m5, Elgeseter gate")
    changes = changes.set_geometry([line.interpolate(5.0)], crs=signs.crs)
    figure = Figure(figsize=(8, 8), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    window = Window(270_030.0, 7_041_030.0, 40.0, 40.0)
    frame_map(axes, window)
    some = dataclasses.replace(layers, nvdb_signs=kept, drives=drives, changes=changes)
    assert draw_road_names(axes, window, some) == 1
    (name,) = axes.texts
    assert name.get_text() == "FV6680 Elgeseter gate"
    assert name.get_rotation() == pytest.approx(45.0)
    middle = line.interpolate(35.0)
    assert name.get_position() == pytest.approx((middle.x, middle.y))


@pytest.mark.parametrize(("ending", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_map_is_written_as_its_name_ends(
    layers: ExportLayers, tmp_path: Path, ending: str, begins: bytes
) -> None:
    """SVG and PDF for print, the same bytes at every run."""
    first = render_map(layers, tmp_path / f"a.{ending}").read_bytes()
    assert first.startswith(begins)
    assert render_map(layers, tmp_path / f"b.{ending}").read_bytes() == first
    with pytest.raises(ConfigError, match=r"map\.jpg is neither PNG, SVG nor PDF"):
        render_map(layers, tmp_path / "map.jpg")


def test_picture_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """The sentence names the file."""
    with pytest.raises(TwinError, match=r"cannot write .*map\.png"):
        render_map(empty_layers(), tmp_path / "nowhere" / "map.png", dpi=40)


def test_labels_keep_clear_of_each_other() -> None:
    """A dozen points 25 pixels apart get labels that cover neither each other nor a point."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), dpi=100)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 800)
    axes.set_ylim(0, 800)
    xy = np.array([[300.0 + 25 * (i % 3), 300.0 + 25 * (i // 3)] for i in range(12)])
    assert place_labels(axes, xy, [f"36{i}.50" for i in range(12)]) == 0
    boxes = [text.get_window_extent() for text in axes.texts]
    assert len(boxes) == 12
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    dots = axes.transData.transform(xy)
    assert not any(box.contains(*dot) for box in boxes for dot in dots)


def test_labels_of_one_pole_are_one_label() -> None:
    """Plates at the same place share a label, a line each and none twice; an empty text gives none."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure()
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 100)
    axes.set_ylim(0, 100)
    xy = np.array([[50.0, 50.0], [50.1, 50.0], [50.0, 50.1], [80.0, 80.0]])
    place_labels(axes, xy, ["362.50", "808", "362.50", ""])
    assert [text.get_text() for text in axes.texts] == ["362.50\n808"]
