"""A 2D world to simulate in: obstacles, ray casting, a differential-drive base and a swept lidar."""
