"""The only wiring: a station file becomes devices, sequencer, records and procedures."""
