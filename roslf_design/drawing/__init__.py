"""Pictures: what is drawn as data, printed as SVG or on matplotlib Axes."""
