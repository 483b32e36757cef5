"""gimbal."""
