"""How often laws are tried of which one example takes long, and the letters of texts."""

from hypothesis import settings
from hypothesis import strategies as st

DEAR = settings(max_examples=settings.default.max_examples * 2 // 5)
"""For laws whose one example takes over 20 ms: ten where others have 25, and as many more in another profile."""

LETTERS = st.characters(exclude_categories=["Cs"])
"""All that UTF-8 has a form for: asked for by that name, hypothesis tries a million letters first, which takes 2 s."""
