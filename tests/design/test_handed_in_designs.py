"""Whatever is handed in to designs, objectives and tunings: refused by name, or right."""
from __future__ import annotations
