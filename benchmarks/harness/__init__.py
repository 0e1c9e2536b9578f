"""How speeds are measured side by side: peers in Pythons of their own, the same work, results first, then times."""
