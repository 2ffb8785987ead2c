"""Memory of a process: where the scripts that import it from here find it."""

from optimisation.memory import peak_memory as peak_memory
