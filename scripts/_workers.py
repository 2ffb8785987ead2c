"""Tasks in processes: where the scripts that import them from here find them."""

from optimisation.workers import Outcome as Outcome
from optimisation.workers import Pool as Pool
from optimisation.workers import Task as Task
