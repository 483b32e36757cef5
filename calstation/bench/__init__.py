"""The virtual bench: truth of its own, a table and an IMU behind real protocols."""
