from __future__ import annotations

from hypothesis import settings

settings.register_profile("workbench", derandomize=True, deadline=None)
settings.load_profile("workbench")
