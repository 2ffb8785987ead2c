"""Progress bars: where the scripts that import them from here find them."""

from optimisation.progress import BAR as BAR
from optimisation.progress import UNIT_BAR as UNIT_BAR
from optimisation.progress import counting_bar as counting_bar
from optimisation.progress import runs_bar as runs_bar
from optimisation.progress import sweeps_bar as sweeps_bar
