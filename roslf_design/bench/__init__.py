"""From the design to the bench and back: targets, captures, acceptance."""
