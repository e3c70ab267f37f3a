"""Who may do what with a store in PostgreSQL: four group roles, and what each is granted."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum

from twin.store import schema
from twin.store.postgres_tables import LOGS, SCHEMA
from twin.store.qgis_views import CHANGES, EDITABLE, FUNCTION, LAYERS, QGIS_SCHEMA


class Role(StrEnum):
    """A group that logins are put into: ``GRANT twin_reviewer TO kari``."""

    READER = "twin_reader"
    REVIEWER = "twin_reviewer"
    INGESTER = "twin_ingester"
    OWNER = "twin_owner"


_BOTH = f"{SCHEMA}, {QGIS_SCHEMA}"
_SIGNED = f"""
CREATE OR REPLACE FUNCTION {SCHEMA}.signed_by_login() RETURNS trigger LANGUAGE plpgsql
  SET search_path = pg_catalog, pg_temp AS
$$ BEGIN
  -- An owner brings decisions along from another store; a match carries them over to what it finds anew.
  IF NEW."by" = CAST(session_user AS text) OR pg_has_role(session_user, '{Role.OWNER}', 'MEMBER')
      OR (NEW.kind IN ('reopened', 'suppressed', 'lifted', 'carried')
        AND pg_has_role(session_user, '{Role.INGESTER}', 'MEMBER')) THEN
    RETURN NEW;
  END IF;
  RAISE EXCEPTION USING ERRCODE = 'insufficient_privilege',
    MESSAGE =
    'the login ' || session_user || ' decides in its own name alone, not as ' || NEW."by";
END $$
"""
_TRIGGER = "decision_log_signed"


def roles() -> Iterator[str]:
    """Yield all that ``twin store init-roles`` runs, as the store's owner who may make roles."""
    for role in Role:
        yield (
            f"DO $$ BEGIN IF NOT EXISTS (SELECT FROM pg_roles WHERE rolname = '{role}') "
            f"THEN CREATE ROLE {role} NOLOGIN; END IF; END $$"
        )
    # Who runs this stays among the owners: he upgrades the store.
    yield f"GRANT {Role.OWNER} TO CURRENT_USER"
    yield f"GRANT {Role.READER} TO {Role.REVIEWER}, {Role.INGESTER}"
    for name in (SCHEMA, QGIS_SCHEMA):
        yield f"ALTER SCHEMA {name} OWNER TO {Role.OWNER}"
    log = f"{SCHEMA}.{schema.decision_log.name}"
    yield _SIGNED
    yield f"DROP TRIGGER IF EXISTS {_TRIGGER} ON {log}"
    yield (
        f"CREATE TRIGGER {_TRIGGER} BEFORE INSERT ON {log} FOR EACH ROW "
        f"EXECUTE FUNCTION {SCHEMA}.signed_by_login()"
    )
    for table in schema.metadata.sorted_tables:
        yield f"ALTER TABLE {SCHEMA}.{table.name} OWNER TO {Role.OWNER}"
    for view in (f"{SCHEMA}.{schema.decision.name}", *(f"{QGIS_SCHEMA}.{name}" for name in LAYERS)):
        yield f"ALTER VIEW {view} OWNER TO {Role.OWNER}"
    for function in (f"{SCHEMA}.never_changed", f"{SCHEMA}.signed_by_login", FUNCTION):
        yield f"ALTER FUNCTION {function}() OWNER TO {Role.OWNER}"
    yield from rights()


def rights() -> Iterator[str]:
    """Yield what the roles are granted, as the store's owner; run again after each upgrade."""
    logs = {table for table, _ in LOGS}
    later = f"ALTER DEFAULT PRIVILEGES FOR ROLE {Role.OWNER}"
    yield f"GRANT USAGE ON SCHEMA {_BOTH} TO {Role.READER}"
    yield f"GRANT SELECT ON ALL TABLES IN SCHEMA {_BOTH} TO {Role.READER}"
    yield f"{later} IN SCHEMA {_BOTH} GRANT SELECT ON TABLES TO {Role.READER}"
    log = schema.decision_log.name
    yield f"GRANT INSERT ON {SCHEMA}.{log} TO {Role.REVIEWER}"
    yield f"GRANT USAGE ON SEQUENCE {SCHEMA}.{log}_id_seq TO {Role.REVIEWER}"
    for name in CHANGES:
        yield f"GRANT UPDATE ({', '.join(EDITABLE)}) ON {QGIS_SCHEMA}.{name} TO {Role.REVIEWER}"
    for table in schema.metadata.sorted_tables:
        may = "INSERT" if table in logs else "INSERT, UPDATE, DELETE"
        yield f"GRANT {may} ON {SCHEMA}.{table.name} TO {Role.INGESTER}"
    yield f"GRANT USAGE ON ALL SEQUENCES IN SCHEMA {SCHEMA} TO {Role.INGESTER}"
    yield f"{later} IN SCHEMA {SCHEMA} GRANT USAGE ON SEQUENCES TO {Role.INGESTER}"
