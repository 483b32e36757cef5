"""Gyro misalignment from the joints of a stabilised gimbal."""
