"""Measurements: IMU streams, placement and calibration of sensors, detections, recordings and scenes."""
