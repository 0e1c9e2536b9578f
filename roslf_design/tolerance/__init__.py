"""What a real build will do: what may be missed, Monte Carlo, yield, sensitivities, inverse tolerances, adjustments."""
