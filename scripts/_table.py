"""Tables: where the scripts that import them from here find them."""

from optimisation.report.markdown import markdown as markdown
