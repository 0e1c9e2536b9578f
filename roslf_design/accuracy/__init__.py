"""How far every number can be trusted, and what accuracy costs in time."""

from __future__ import annotations
