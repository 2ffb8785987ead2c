"""Tasks in processes: where the scripts that import them from here find them."""

from optimisation.studies.workers import Outcome as Outcome
from optimisation.studies.workers import Pool as Pool
from optimisation.studies.workers import Task as Task
