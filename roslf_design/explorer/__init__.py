"""The explorer: a local web page on which a design follows sliders, and pictures follow the design."""
