"""What light meets before the main lens: parts that answer for themselves, and one walk through them."""
