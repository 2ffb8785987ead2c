"""Errors and exit codes: where the scripts that import them from here find them."""

from optimisation.command_line import INTERRUPTED as INTERRUPTED
from optimisation.command_line import BadInput as BadInput
from optimisation.command_line import check_target as check_target
from optimisation.command_line import end_early as end_early
from optimisation.command_line import end_without as end_without
from optimisation.command_line import name_files as name_files
from optimisation.command_line import plain_errors as plain_errors
