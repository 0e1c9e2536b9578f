"""How often laws are tried of which one example takes long."""

from hypothesis import settings

DEAR = settings(max_examples=settings.default.max_examples * 2 // 5)
"""For laws whose one example takes over 20 ms: ten where others have 25, and as many more in another profile."""
