"""True motion, sensors and errors, drawn from a seed; no protocols and no time of their own."""
