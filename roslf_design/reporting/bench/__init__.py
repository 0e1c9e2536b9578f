"""Pages about a bench: targets to print, protocol, what captures are worth."""
