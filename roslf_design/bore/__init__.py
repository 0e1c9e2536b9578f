"""Parts that light meets before the main lens, each of which answers for itself, and the one walk through them."""
