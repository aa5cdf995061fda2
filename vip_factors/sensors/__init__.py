"""What was measured: IMU streams, where each sensor sits, calibration, and the recording that holds them."""
