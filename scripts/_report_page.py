"""Pages with tables between markers: where the scripts that import them from here find them."""

from optimisation.studies.machine import conditions as conditions
from optimisation.studies.machine import sources as conditions_line  # noqa: F401
from optimisation.studies.page import ROOT as ROOT
from optimisation.studies.page import fill as fill
from optimisation.studies.page import published as published
from optimisation.studies.page import require_markers as require_markers
