from .sync import SyncResult as SyncResult
from .sync import sync_nvdb as sync_nvdb
