"""Rays through stops, main lens and microlenses, every one with a fate."""

from .pupil import PASSED, Fan, PupilRays, fans, glass_shares, paths, trace_pupil

__all__ = ["PASSED", "Fan", "PupilRays", "fans", "glass_shares", "paths", "trace_pupil"]
