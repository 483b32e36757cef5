"""Raw logs, results and reports: what remains."""
