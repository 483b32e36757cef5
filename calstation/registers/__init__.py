"""Register operations: transfers and their journal, recovery of interrupted ones, verification of the output.

Devices only move bytes; whether, why and with what result registers are written is decided here.
"""
