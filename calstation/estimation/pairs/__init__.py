"""Cross-calibration of IMUs on one body: checks, fit and live watch."""
