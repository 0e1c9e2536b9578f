"""Rays through stops, main lens and microlenses, every one with a fate."""

from .pupil import Fan, PupilRays, fans, trace_pupil
from .status import PASSED, Status, describe

__all__ = ["PASSED", "Fan", "PupilRays", "Status", "describe", "fans", "trace_pupil"]
