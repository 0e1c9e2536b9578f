"""From a design to its bench: targets and protocol for a camera that was built, and what its captures are worth."""
