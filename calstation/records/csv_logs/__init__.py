"""Logs as CSV: a file with its TOML file, or a folder with one file for each position.

The columns are defined in `calstation.records.columns`, which the formats of other programs share.
"""

from calstation.records.csv_logs.csv_folder import csv_files, open_folder
from calstation.records.csv_logs.csv_log import CSV_SUFFIXES, complete_counts, meta_path, open_csv, recorded_log
from calstation.records.csv_logs.csv_text import csv_rows
from calstation.records.csv_logs.csv_write import write_csv_log
