"""The page and pictures of a calibration."""
