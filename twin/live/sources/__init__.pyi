from .address import Gives as Gives
from .open import open_source as open_source
