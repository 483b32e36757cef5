"""Serial lines, Modbus servers and the clock service through which a station reaches the bench."""
