"""Data for the plots of logs and results, computed without Qt."""
