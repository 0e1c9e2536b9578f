"""What accuracy costs: measures the package's table, walks the hard cases, draws the diagrams."""
