"""Measured records from files: CSV, WAV, NumPy arrays and Universal Files.

Every field of a file that changes its meaning (units, kind of data, axis, number of samples) is
used, or the file is refused with one line.
"""

from impact_env.records.channels import RecordOptions as RecordOptions
from impact_env.records.reading import RECORD_READERS as RECORD_READERS
from impact_env.records.reading import read_record as read_record
