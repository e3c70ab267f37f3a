from .answers import JsonObject as JsonObject
from .answers import json_from_body as json_from_body
from .client import API_URL as API_URL
from .client import Json as Json
from .client import NvdbClient as NvdbClient
from .client import Params as Params
from .client import Reply as Reply
from .paging import iter_pages as iter_pages
