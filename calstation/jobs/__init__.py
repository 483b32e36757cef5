"""Background jobs: a queue whose worker process reports progress and can be killed. No job is defined here."""
