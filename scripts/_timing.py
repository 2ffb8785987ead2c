"""Runs that can be timed: where the scripts that import them from here find them."""

from optimisation.studies.timing import Timed as Timed
