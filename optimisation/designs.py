"""Names of `optimisation.space` as they were before; for one release."""

from optimisation.space import Design as Design
from optimisation.space import DesignSpace as DesignSpace
from optimisation.space import design_space as design_space
