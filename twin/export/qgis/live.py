"""Styles of the live layers, where QGIS looks for them in a database: ``public.layer_styles``."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree as ET

import sqlalchemy as sa

from twin.errors import ConfigError
from twin.export.layers import COLUMNS, description
from twin.export.qgis.qml import DOCTYPE, style
from twin.store.postgres_tables import GEOMETRY
from twin.store.qgis_views import EDITABLE, LAYERS, QGIS_SCHEMA
from twin.store.store import Store
from twin.words import Lang

# As QGIS makes it on "Save style in database".
_TABLE = """
CREATE TABLE IF NOT EXISTS public.layer_styles (
  id SERIAL PRIMARY KEY, f_table_catalog varchar, f_table_schema varchar, f_table_name varchar,
  f_geometry_column varchar, styleName text, styleQML xml, styleSLD xml, useAsDefault boolean,
  description text, owner varchar(63) DEFAULT CURRENT_USER, ui xml,
  update_time timestamp DEFAULT CURRENT_TIMESTAMP, type varchar)
"""
_BEFORE = sa.text(
    "DELETE FROM public.layer_styles WHERE f_table_catalog = current_database() AND f_table_schema = :schema "
    "AND f_table_name = :layer AND stylename = CAST(:layer AS varchar)"
)
_STYLE = sa.text(
    "INSERT INTO public.layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, "
    "stylename, styleqml, useasdefault, description) VALUES (current_database(), :schema, :layer, "
    ":geometry, CAST(:layer AS varchar), XMLPARSE(DOCUMENT :qml), true, :description)"
)
_HAS = sa.text(
    "SELECT column_name FROM information_schema.columns WHERE table_schema = :schema AND table_name = :layer"
)


def write_styles(store: Store, lang: Lang = Lang.EN) -> tuple[str, ...]:
    """Put the exported layers' styles into the database of a store, in the place of those of before.

    Returns
    -------
    tuple of str
        The layers.

    Raises
    ------
    ConfigError
        The store is a file.
    StoreError
        This user may not write them.
    """
    if store.login is None:
        raise ConfigError(
            f"The store {store.name} is a file, which has no live layers: `twin export` writes its layers."
        )
    with store.transaction() as connection:
        connection.exec_driver_sql(_TABLE)
        connection.exec_driver_sql("GRANT SELECT ON public.layer_styles TO PUBLIC")
        for layer, exported in LAYERS.items():
            row: dict[str, Any] = {"schema": QGIS_SCHEMA, "layer": layer, "geometry": GEOMETRY}
            has = set(connection.execute(_HAS, row).scalars())
            row |= {"qml": _live(exported, has, lang), "description": description(exported, lang)}
            connection.execute(_BEFORE, row)
            connection.execute(_STYLE, row)
    return tuple(LAYERS)


def _live(exported: str, has: set[str], lang: Lang) -> str:
    """Make the style of an exported layer one of a view, which lacks some of its columns."""
    from defusedxml.ElementTree import fromstring

    root = fromstring(style(exported, verdicts=(), lang=lang))
    tip = root.find("mapTip")
    for column in COLUMNS[exported]:
        if tip is not None and tip.text and column.name not in has:
            tip.text = tip.text.replace(f'"{column.name}"', "NULL")
    for field in root.iterfind("./editable/field"):
        if field.get("name") not in EDITABLE:
            field.set("editable", "0")
    return f"{DOCTYPE}\n{ET.tostring(root, encoding='unicode')}\n"
