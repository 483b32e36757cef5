"""The table's controller and its protocols."""
