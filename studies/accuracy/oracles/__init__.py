"""References at many digits that share nothing with the package: traced rays, textbook formulas, sliced discs."""
