"""Joint solution of rests and motions without table angles, and the checks and guidance of such recordings."""
