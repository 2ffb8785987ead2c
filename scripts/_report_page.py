"""Pages with tables between markers: where the scripts that import them from here find them."""

from optimisation.studies.page import ROOT as ROOT
from optimisation.studies.page import fill as fill
from optimisation.studies.page import published as published
